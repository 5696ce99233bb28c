//! How finely pictures are decoded for the views that a scene is imported for.

use std::f32::consts::TAU;

use glam::{Affine3A, Mat2, Vec2, Vec3A};

use crate::scene::import::options::Views;
use crate::scene::{AlphaMode, Material, Projection, Scene, Texture, TextureRef, TextureSlot, choose};

/// Most halvings of a picture's sides.
const MAX_HALVINGS: u32 = 3;
/// Pictures of fewer texels are decoded as they are.
const MIN_TEXELS: u64 = 1 << 18;
/// Texels per pixel that remain at least.
const MIN_TEXELS_PER_PIXEL: f32 = 2.0;
/// Of what shows a picture, at most this share may have fewer.
const MAX_COARSE: f32 = 0.001;
/// About so many triangles are looked at.
const TRIANGLES: usize = 1 << 18;
/// Surfaces of less roughness may magnify what they mirror.
const MIN_ROUGHNESS: f32 = 0.3;

/// How often the sides of each picture are halved, where `textures` use pictures of these sizes. Only what the mean of linear light
/// shows as the texels do is halved: base colours of opaque materials without other textures, in scenes where nothing mirrors or
/// refracts sharply. Both sides stay whole numbers of texels. Triangles count as if they faced the camera at their nearest point,
/// and as finely as they show a texel's longer side, so most have more texels than they need. Without halvings if a view is not
/// known.
pub fn halvings(scene: &Scene, textures: &[Texture], sizes: &[[u32; 2]], views: &Views) -> Vec<u32> {
    let of_size = |&[width, height]: &[u32; 2]| match u64::from(width) * u64::from(height) > MIN_TEXELS {
        true => (width | height).trailing_zeros().min(MAX_HALVINGS),
        false => 0,
    };
    let mut found: Vec<u32> = sizes.iter().map(of_size).collect();
    let picture = |texture: &TextureRef| textures[texture.texture as usize].image as usize;
    let is_sharp = scene.materials.iter().any(is_sharp);
    for material in scene.materials.iter().filter(|material| is_sharp || !shows_means(material)) {
        material.textures.iter().for_each(|texture| found[picture(texture)] = 0);
    }
    let Some(eyes) = found.iter().any(|n| *n > 0).then(|| eyes(scene, views)).flatten() else {
        return vec![0; sizes.len()];
    };
    let placed = || scene.instances.iter().map(|instance| (instance, &scene.objects[instance.object as usize]));
    let step = placed().map(|(instance, _)| scene.triangles(instance.object)).sum::<usize>() / TRIANGLES + 1;
    // Pixels that show each picture, by the halvings that they allow.
    let mut pixels = vec![[0.0; MAX_HALVINGS as usize + 1]; sizes.len()];
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
                    let image = picture(texture);
                    let corners = mesh.corner_texcoords(texture, triangle);
                    let matrix = texture.transform.map_or(Mat2::IDENTITY, |to| to.matrix2);
                    let size = Vec2::from(sizes[image].map(|n| n as f32));
                    let sides = [1, 2].map(|i| matrix * (corners[i] - corners[0]) * size);
                    let texels = area * texels_per_area([b - a, c - a], sides);
                    // No comparison holds for NaN.
                    if shown > 0.0 {
                        let spare = 0.5 * (texels / shown / MIN_TEXELS_PER_PIXEL).log2();
                        pixels[image][(spare.max(0.0) as usize).min(MAX_HALVINGS as usize)] += shown;
                    }
                }
            }
        }
    }
    for (found, pixels) in found.iter_mut().zip(&pixels) {
        let all: f32 = pixels.iter().sum();
        let coarse = |most: &u32| pixels[..*most as usize].iter().sum::<f32>() <= MAX_COARSE * all;
        *found = (0..=*found).rfind(coarse).unwrap_or(0);
    }
    found
}

/// Does the mean of its texture show what the texture shows from afar? Other textures, alpha tests and shadows of alpha are no
/// sums.
fn shows_means(material: &Material) -> bool {
    let is_only = material.textures[TextureSlot::BaseColor].is_some() && material.textures.iter().count() == 1;
    is_only && material.alpha_mode == AlphaMode::Opaque
}

/// May the material reflect or refract so sharply that it shows a texture larger than the camera sees it?
fn is_sharp(material: &Material) -> bool {
    let is_smooth = material.roughness < MIN_ROUGHNESS || material.textures[TextureSlot::MetallicRoughness].is_some();
    !material.unlit && (is_smooth || material.clearcoat > 0.0 || material.transmission > 0.0)
}

/// Squared texels per metre along the direction in which a triangle has the fewest, from two sides in metres and in texels: the
/// smaller singular value of the map between them, squared.
fn texels_per_area(metres: [Vec3A; 2], texels: [Vec2; 2]) -> f32 {
    let [[a, b, c], [d, e, f]] = [
        [metres[0].length_squared(), metres[0].dot(metres[1]), metres[1].length_squared()],
        [texels[0].length_squared(), texels[0].dot(texels[1]), texels[1].length_squared()],
    ];
    let determinant = a * c - b * b;
    let sum = (c * d - 2.0 * b * e + a * f) / determinant;
    let product = texels[0].perp_dot(texels[1]).powi(2) / determinant;
    2.0 * product / (sum + (sum * sum - 4.0 * product).max(0.0).sqrt())
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
        // At the corners a pixel covers a smaller solid angle.
        let tangent = if parallel { 0.0 } else { half * (width as f32 / height as f32).hypot(1.0) };
        let pixels = 0.5 * height as f32 / half * (1.0 + tangent * tangent).powf(0.75);
        Eye { position: camera.to_world.translation, pixels, parallel }
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
        let reference = TextureRef { texture: 0, set: 0, transform: None, encoding: Encoding::Srgb };
        let mut material = Material::default();
        material.textures[TextureSlot::BaseColor] = Some(reference.clone());
        let mut scene = Scene { cameras: vec![Camera::look_at(4.0 * Vec3::Z, Vec3::ZERO, 0.25)], ..Default::default() };
        scene.add(mesh, material);
        let texture = Texture { image: 0, wrap_s: Wrap::Repeat, wrap_t: Wrap::Repeat, filter: Filter::Linear };
        let seen = |scene: &Scene, size: [u32; 2], pixels: u32, camera: Option<&str>| {
            let views = Views { size: [pixels; 2], orbits: Vec::new(), camera: camera.map(Into::into) };
            halvings(scene, std::slice::from_ref(&texture), &[size], &views)[0]
        };
        let of = |side: u32, pixels: u32, camera: Option<&str>| seen(&scene, [side; 2], pixels, camera);
        // As near as they could be, the triangles have 1.4 texels a pixel after two halvings, and two with half of the pixels.
        assert_eq!([512, 256, 128, 64, 4096].map(|pixels| of(4096, pixels, None)), [2, 3, 3, 3, 0]);
        assert_eq!([of(1024, 512, None), of(512, 16, None), of(4096, 64, Some("other"))], [0, 0, 0]);
        assert_eq!([[4100, 4096], [4098, 4096], [4097, 4096]].map(|size| seen(&scene, size, 64, None)), [2, 1, 0]);
        // What no mean shows stays; beside it, what may be magnified.
        let with = |change: &dyn Fn(&mut Scene)| {
            let mut scene = scene.clone();
            change(&mut scene);
            seen(&scene, [4096; 2], 64, None)
        };
        let slot = |slot: TextureSlot| {
            let reference = &reference;
            move |scene: &mut Scene| scene.materials[0].textures[slot] = Some(reference.clone())
        };
        let other = |material: Material| move |scene: &mut Scene| scene.materials.push(material.clone());
        let coordinates = |of: fn([f32; 2]) -> [f32; 2]| {
            move |scene: &mut Scene| {
                let mesh = std::sync::Arc::make_mut(&mut scene.meshes[0]);
                mesh.texcoords[0].iter_mut().flatten().for_each(|uv| *uv = of(*uv));
            }
        };
        let smooth = Material { roughness: 0.1, ..Default::default() };
        for (what, right, found) in [
            ("as it is", 3, with(&|_| ())),
            ("mask", 0, with(&|scene| scene.materials[0].alpha_mode = AlphaMode::Mask(0.5))),
            ("blend", 0, with(&|scene| scene.materials[0].alpha_mode = AlphaMode::Blend)),
            ("roughness too", 0, with(&slot(TextureSlot::MetallicRoughness))),
            ("normals too", 0, with(&slot(TextureSlot::Normal))),
            ("emission too", 0, with(&slot(TextureSlot::Emissive))),
            ("a mirror", 0, with(&other(smooth.clone()))),
            ("glass", 0, with(&other(Material { transmission: 1.0, ..Default::default() }))),
            ("an unlit surface", 3, with(&other(Material { unlit: true, ..smooth }))),
            ("a palette", 0, with(&coordinates(|_| [0.3, 0.4]))),
            ("a gradient", 0, with(&coordinates(|[u, _]| [u, 0.4]))),
            ("stretched", 1, with(&coordinates(|[u, v]| [u, v / 16.0]))),
        ] {
            assert_eq!(found, right, "{what}");
        }
    }
}
