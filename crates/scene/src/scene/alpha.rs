//! Alpha-tested and alpha-blended surfaces: which hits count.

use super::{AlphaMode, Mesh, Scene, TextureSlot};

impl Scene {
    /// Can a ray pass through this mesh (alpha mask or blend that is not opaque everywhere)? If not, the ray backends
    /// need no intersection filter. Examines every texel and vertex: call once per mesh.
    #[inline]
    pub fn has_alpha(&self, mesh: u32) -> bool {
        let mesh = &self.meshes[mesh as usize];
        let material = &self.materials[mesh.material as usize];
        let needed = match material.alpha_mode {
            AlphaMode::Opaque => return false,
            AlphaMode::Mask(cutoff) => cutoff,
            AlphaMode::Blend => 1.0,
        };
        if material.base_color.w < needed {
            return true;
        }
        // Alpha is a product of three factors of at most 1. Which texel meets which vertex is not known here, so the test is
        // conservative: the lowest texel with the lowest vertex alpha.
        let vertex = mesh.colors.iter().flatten().map(|c| c[3]).fold(1.0, f32::min);
        let without_texture = material.base_color.w * vertex;
        if without_texture < needed {
            return true;
        }
        material.textures[TextureSlot::BaseColor].as_ref().is_some_and(|texture| {
            let image = self.textures[texture.texture as usize].image;
            without_texture > 0.0 && self.images[image as usize].texels.has_alpha_below(needed / without_texture)
        })
    }

    /// Can anything see this mesh: has its texture, if alpha matters, a texel that shows? What factors hide is not imported.
    pub fn is_seen(&self, mesh: u32) -> bool {
        let image = || {
            // While a scene is imported, these are not there yet.
            let material = self.materials.get(self.meshes[mesh as usize].material as usize)?;
            let texture = material.textures[TextureSlot::BaseColor].as_ref().filter(|_| material.shows(1.0))?;
            Some((material, &self.images[self.textures.get(texture.texture as usize)?.image as usize]))
        };
        image().is_none_or(|(material, image)| image.texels.any_alpha(|alpha| material.shows(alpha)))
    }

    /// Probability that a hit counts, in [0, 1]: how much of its light a lamp gives where a light sample chooses this point.
    /// Arguments as of [`is_present`](Self::is_present).
    #[inline]
    pub fn coverage(&self, surface: &Mesh, prim: u32, (u, v): (f32, f32)) -> f32 {
        match self.materials[surface.material as usize].alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f32::from(u8::from(self.base_color_alpha(surface, prim, u, v) >= cutoff)),
            AlphaMode::Blend => self.base_color_alpha(surface, prim, u, v).clamp(0.0, 1.0),
        }
    }

    /// Does this hit count? Mask compares alpha with the cutoff. Blend compares it with a hash of (`key`, `instance`, `mesh`,
    /// `prim`): the surface is present with probability alpha, equally for every backend and thread. (`u`, `v`) are the
    /// barycentric weights of the second and third vertex of triangle `prim`.
    #[inline]
    pub fn is_present(&self, key: u32, instance: u32, mesh: u32, prim: u32, u: f32, v: f32) -> bool {
        let surface = &self.meshes[mesh as usize];
        let mode = self.materials[surface.material as usize].alpha_mode;
        match mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => self.base_color_alpha(surface, prim, u, v) >= cutoff,
            AlphaMode::Blend => hash_to_unit(key, instance, mesh, prim) < self.base_color_alpha(surface, prim, u, v),
        }
    }

    /// Base colour alpha at barycentric weights (`u`, `v`) on triangle `prim`.
    fn base_color_alpha(&self, mesh: &Mesh, prim: u32, u: f32, v: f32) -> f32 {
        let material = &self.materials[mesh.material as usize];
        let mut alpha = material.base_color.w;
        if let Some(texture) = &material.textures[TextureSlot::BaseColor] {
            alpha *= self.sample_alpha(texture, mesh.texcoord(texture, prim, (u, v)));
        }
        if let Some(colors) = &mesh.colors {
            let [a, b, c] = mesh.indices[prim as usize].map(|i| colors[i as usize][3]);
            alpha *= a + u * (b - a) + v * (c - a);
        }
        alpha
    }
}

/// A hash in [0, 1) of four words; each passes a bijective mixer (Wellons' lowbias32).
fn hash_to_unit(key: u32, instance: u32, mesh: u32, prim: u32) -> f32 {
    let mix = |mut x: u32| {
        x ^= x >> 16;
        x = x.wrapping_mul(0x7feb_352d);
        x ^= x >> 15;
        x = x.wrapping_mul(0x846c_a68b);
        x ^ x >> 16
    };
    let hash = [instance, mesh, prim].iter().fold(mix(key), |hash, &word| {
        mix(hash.wrapping_add(0x9e37_79b9).wrapping_add(mix(word ^ hash.rotate_left(16))))
    });
    (hash >> 8) as f32 / (1 << 24) as f32
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;
    use crate::scene::{Encoding, Filter, Image, Material, Positions, Texels, Texture, TextureRef, Wrap};

    fn scene(mode: AlphaMode, factor: f32, texture: Option<u8>, vertex: Option<f32>) -> Scene {
        let texture_ref = TextureRef { texture: 0, set: 0, transform: None, encoding: Encoding::Srgb };
        let mut material =
            Material { base_color: Vec4::new(1.0, 1.0, 1.0, factor), alpha_mode: mode, ..Default::default() };
        material.textures[TextureSlot::BaseColor] = texture.map(|_| texture_ref);
        let mesh = Mesh {
            positions: Positions::new(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
            texcoords: [Some(vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), None],
            colors: vertex.map(|a| vec![[1.0, 1.0, 1.0, a]; 3]),
            indices: vec![[0, 1, 2]],
            ..Default::default()
        };
        let (wrap_s, wrap_t, filter) = (Wrap::Repeat, Wrap::Repeat, Filter::Linear);
        let texels = Texels::Rgba8(vec![[255, 255, 255, texture.unwrap_or(255)]]);
        Scene {
            meshes: vec![mesh.into()],
            materials: vec![material],
            images: vec![Image { name: "test".into(), width: 1, height: 1, texels, ..Default::default() }.into()],
            textures: vec![Texture { image: 0, wrap_s, wrap_t, filter }],
            ..Default::default()
        }
    }

    #[test]
    fn only_what_can_fall_below_needs_a_filter() {
        use AlphaMode::*;
        let has = |mode, factor, texture, vertex| scene(mode, factor, texture, vertex).has_alpha(0);
        assert!(!has(Opaque, 0.0, Some(0), Some(0.0)));
        assert!(!has(Mask(0.5), 0.5, None, None));
        assert!(has(Mask(0.5), 0.25, None, None));
        assert!(has(Mask(0.5), 1.0, Some(127), None));
        assert!(!has(Mask(0.5), 1.0, Some(128), None));
        assert!(has(Mask(0.5), 0.75, Some(128), None));
        assert!(has(Mask(0.5), 0.75, None, Some(0.5)));
        assert!(!has(Mask(0.0), 0.0, Some(0), Some(0.0)));
        assert!(!has(Blend, 1.0, Some(255), Some(1.0)));
        assert!(has(Blend, 0.999, None, None));
        assert!(has(Blend, 1.0, Some(254), None));
        assert!(has(Blend, 1.0, None, Some(0.9)));
    }

    #[test]
    fn mask_is_present_from_the_cutoff_on() {
        let present =
            |factor| scene(AlphaMode::Mask(0.5), factor, Some(255), Some(1.0)).is_present(1, 0, 0, 0, 0.25, 0.25);
        assert!(present(0.5));
        assert!(!present(0.499));
    }

    #[test]
    fn blend_is_present_with_probability_alpha_and_always_decides_alike() {
        let scene = scene(AlphaMode::Blend, 0.5, Some(153), Some(0.5)); // 0.5 · 0.6 · 0.5
        let n = 100_000;
        let present = |key| scene.is_present(key, 3, 0, 0, 0.25, 0.25);
        let hits = (0..n).filter(|&key| present(key)).count();
        // Binomial with p = 0.15: five standard deviations are exceeded once in 1.7 million such tests.
        let sigma = (f64::from(n) * 0.15 * 0.85).sqrt();
        assert!((hits as f64 - 0.15 * f64::from(n)).abs() < 5.0 * sigma, "{hits}");
        assert!((0..100).all(|key| present(key) == present(key)));
    }

    #[test]
    fn layers_decide_independently() {
        // Of two layers at 0.5 seen with the same key, a quarter of rays must pass both.
        let n = 100_000;
        let both = |a: [u32; 3], b: [u32; 3]| {
            (0..n)
                .filter(|&k| hash_to_unit(k, a[0], a[1], a[2]) < 0.5 && hash_to_unit(k, b[0], b[1], b[2]) < 0.5)
                .count() as f64
        };
        let sigma = (f64::from(n) * 0.25 * 0.75).sqrt();
        for (a, b) in [([0, 0, 0], [0, 0, 1]), ([0, 0, 0], [1, 0, 0]), ([1, 0, 0], [0, 1, 0]), ([0, 5, 7], [0, 7, 5])] {
            assert!((both(a, b) - 0.25 * f64::from(n)).abs() < 5.0 * sigma, "{a:?} {b:?}");
        }
    }

    #[test]
    fn opaque_blend_is_present_for_every_key() {
        let scene = scene(AlphaMode::Blend, 1.0, Some(255), Some(1.0));
        assert!((0..10_000).all(|key| scene.is_present(key, 0, 0, 0, 0.3, 0.3)));
    }
}
