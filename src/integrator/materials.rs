//! Materials, as far as they are the same everywhere.

use super::geometry::Point;
use crate::bsdf::{MetallicRoughness, Surface};
use crate::scene::{Material, Scene};

/// The scattering of each material that no texture or vertex colour varies, made once.
#[derive(Debug)]
pub struct Materials {
    constant: Vec<Option<MetallicRoughness>>,
}

impl Materials {
    /// Prepares a scene's materials.
    pub fn new(scene: &Scene) -> Self {
        Self { constant: scene.materials.iter().map(constant).collect() }
    }

    /// The scattering at a point.
    #[inline]
    pub fn at(&self, scene: &Scene, point: &Point) -> MetallicRoughness {
        match &self.constant[point.mesh.material as usize] {
            Some(bsdf) if point.mesh.colors.is_none() => *bsdf,
            _ => MetallicRoughness::new(&point.parameters(scene)),
        }
    }
}

fn constant(m: &Material) -> Option<MetallicRoughness> {
    let textured = m.base_color_texture.is_some()
        || m.metallic_roughness_texture.is_some()
        || m.specular_texture.is_some()
        || m.specular_color_texture.is_some();
    (!textured).then(|| {
        MetallicRoughness::new(&Surface {
            base_color: m.base_color.truncate(),
            metallic: m.metallic,
            roughness: m.roughness,
            specular: m.specular,
            specular_color: m.specular_color,
            ior: m.ior,
        })
    })
}
