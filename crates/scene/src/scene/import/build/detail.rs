//! How finely pictures are decoded for the views that a scene is imported for.

use std::f32::consts::TAU;

use glam::{Affine3A, Vec3A};

use crate::scene::import::options::Views;
use crate::scene::{Projection, Scene, Texture, choose};

/// Most halvings of a picture's sides: JPEG is decoded at an eighth at least.
const MAX_HALVINGS: usize = 3;
/// Pictures of fewer texels are decoded as they are.
const MIN_TEXELS: u64 = 1 << 18;
/// Texels per pixel that remain at least.
const MIN_TEXELS_PER_PIXEL: f32 = 2.0;
/// Of what shows a picture, at most this share may have fewer: triangles whose texture coordinates hardly differ.
const MAX_COARSE: f32 = 0.02;
/// About so many triangles are looked at.
const TRIANGLES: usize = 1 << 18;

/// How often the sides of each picture are halved, where `textures` use pictures of these sizes. Triangles count as if they faced
/// the camera at their nearest point, so most have more texels than they need. Without halvings if a view is not known.
pub fn halvings(scene: &Scene, textures: &[Texture], sizes: &[[u32; 2]], views: &Views) -> Vec<u32> {
    let mut found = vec![0; sizes.len()];
    let is_large = |size: &[u32; 2]| u64::from(size[0]) * u64::from(size[1]) > MIN_TEXELS;
    let Some(eyes) = sizes.iter().any(is_large).then(|| eyes(scene, views)).flatten() else { return found };
    let placed = || scene.instances.iter().map(|instance| (instance, &scene.objects[instance.object as usize]));
    let step = placed().map(|(instance, _)| scene.triangles(instance.object)).sum::<usize>() / TRIANGLES + 1;
    // Pixels that show each picture, by the halvings that they allow.
    let mut pixels = vec![[0.0; MAX_HALVINGS + 1]; sizes.len()];
    let most = views.size.map(|n| n as f32).iter().product::<f32>();
    for (instance, object) in placed() {
        let to_world = instance.transform.unwrap_or(Affine3A::IDENTITY);
        for mesh in &scene.meshes[object.meshes.start as usize..object.meshes.end as usize] {
            for &triangle in mesh.indices.iter().step_by(step) {
                let [a, b, c] = triangle.map(|i| to_world.transform_point3a(mesh.positions[i as usize].into()));
                let (center, area) = ((a + b + c) / 3.0, 0.5 * (b - a).cross(c - a).length());
                let radius = [a, b, c].map(|corner| corner.distance(center)).into_iter().fold(0.0, f32::max);
                let density = |eye: &Eye| eye.density(center, radius);
                let shown = (area * eyes.iter().map(density).fold(0.0, f32::max)).min(most);
                for texture in scene.materials[mesh.material as usize].textures.iter() {
                    let image = textures[texture.texture as usize].image as usize;
                    let [a, b, c] = mesh.corner_texcoords(texture, triangle);
                    let scale = texture.transform.map_or(1.0, |to| to.matrix2.determinant().abs());
                    let [width, height] = sizes[image].map(|n| n as f32);
                    let texels = 0.5 * (b - a).perp_dot(c - a).abs() * scale * width * height;
                    // A triangle of one texel, or that is a line, needs none; no comparison holds for NaN.
                    if texels > 0.0 && shown > 0.0 {
                        let spare = 0.5 * (texels / shown / MIN_TEXELS_PER_PIXEL).log2();
                        pixels[image][(spare.max(0.0) as usize).min(MAX_HALVINGS)] += shown;
                    }
                }
            }
        }
    }
    for ((found, pixels), size) in found.iter_mut().zip(&pixels).zip(sizes) {
        let all: f32 = pixels.iter().sum();
        let coarse = |&most: &usize| pixels[..most].iter().sum::<f32>() <= MAX_COARSE * all;
        *found = if is_large(size) { (0..=MAX_HALVINGS).rfind(coarse).unwrap_or(0) as u32 } else { 0 };
    }
    found
}

/// Where a view is seen from.
struct Eye {
    position: Vec3A,
    /// Pixels per metre: at a distance of one metre, or, of a parallel projection, everywhere.
    pixels: f32,
    parallel: bool,
}

impl Eye {
    /// Pixels per square metre, at most, within a sphere.
    fn density(&self, center: Vec3A, radius: f32) -> f32 {
        let distance = if self.parallel { 1.0 } else { (self.position.distance(center) - radius).max(0.0) };
        (self.pixels / distance).powi(2)
    }
}

/// The eyes of all views; `None` if a camera is not known.
fn eyes(scene: &Scene, views: &Views) -> Option<Vec<Eye>> {
    let [width, height] = views.size;
    let cameras: Vec<_> = if views.orbits.is_empty() {
        let names: Vec<_> = scene.cameras.iter().map(|camera| camera.name.clone()).collect();
        let index = views.camera.as_ref().map_or(Some(0), |wanted| choose("camera", wanted, &names).ok())?;
        vec![scene.camera(index, width, height)]
    } else {
        let aspect = f64::from(width) / f64::from(height);
        views.orbits.iter().map(|orbit| orbit.camera(scene, aspect)).collect()
    };
    let eye = |camera: crate::scene::Camera| {
        let (half, parallel) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), false),
            Projection::Orthographic { ymag, .. } => (ymag.abs(), true),
            Projection::Calibrated(of) => ((0.5 * of.h / of.fl_y) as f32, false),
            Projection::Panorama => (0.5 * height as f32 * TAU / width as f32, false),
        };
        Eye { position: camera.to_world.translation, pixels: 0.5 * height as f32 / half, parallel }
    };
    Some(cameras.into_iter().map(eye).collect())
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::scene::{Camera, Encoding, Filter, Material, Mesh, TextureRef, TextureSlot, Wrap};

    #[test]
    fn pictures_keep_the_texels_that_a_view_can_show() {
        // A square metre with the whole picture, seen from one metre: it fills the frame.
        let corners = [[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]];
        let mut mesh = Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]]);
        mesh.texcoords[0] = Some(corners.map(|[x, y, _]| [x + 0.5, y + 0.5]).into());
        let mut material = Material::default();
        let reference = TextureRef { texture: 0, set: 0, transform: None, encoding: Encoding::Srgb };
        material.textures[TextureSlot::BaseColor] = Some(reference);
        let mut scene = Scene { cameras: vec![Camera::look_at(4.0 * Vec3::Z, Vec3::ZERO, 0.25)], ..Default::default() };
        scene.add(mesh, material);
        let texture = Texture { image: 0, wrap_s: Wrap::Repeat, wrap_t: Wrap::Repeat, filter: Filter::Linear };
        let of = |side: u32, pixels: u32, camera: Option<&str>| {
            let views = Views { size: [pixels; 2], orbits: Vec::new(), camera: camera.map(Into::into) };
            halvings(&scene, std::slice::from_ref(&texture), &[[side; 2]], &views)[0]
        };
        // As near as they could be, the triangles have 1.4 texels a pixel after two halvings, and two with half of the pixels.
        assert_eq!([512, 256, 128, 64, 4096].map(|pixels| of(4096, pixels, None)), [2, 3, 3, 3, 0]);
        assert_eq!([of(1024, 512, None), of(512, 16, None), of(4096, 64, Some("other"))], [0, 0, 0]);
    }
}
