//! Kinds and layers of lights, by which the beauty is divided.

use crate::light::Lights;
use crate::scene::Primitive;

/// The kinds of light sources.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightKind {
    /// Light from infinity.
    Environment,
    Area,
    /// Point, spot and directional lights without a size.
    Punctual,
    /// The same with a size.
    Sized,
}

impl LightKind {
    /// All kinds, by their numbers.
    pub const ALL: [Self; 4] = [Self::Environment, Self::Area, Self::Punctual, Self::Sized];

    /// Its layer where none are asked for: environment, emissive surfaces, punctual lights.
    pub const fn layer(self) -> u8 {
        if matches!(self, Self::Sized) { Self::Punctual as u8 } else { self as u8 }
    }
}

/// A light that a light sample has chosen, in one number: its kind, and its index
/// ([`LightSamples::emitter`](crate::light::LightSamples::emitter)).
#[derive(Debug, Clone, Copy)]
pub struct LightNumber(pub u32);

impl LightNumber {
    /// Bits of the kind.
    pub(crate) const BITS: i32 = 2;

    /// Its kind.
    #[inline]
    pub fn kind(self) -> LightKind {
        LightKind::ALL[self.0 as usize & 3]
    }
}

/// Largest number of layers, with that of the lights that no other has.
pub const MAX_LAYERS: usize = 9;

/// The number of the layer of each light of a scene.
#[derive(Debug, Default)]
pub struct LightLayerTable {
    /// That of the environment.
    pub environment: u8,
    /// By index in [`Scene::lights`](crate::scene::Scene::lights).
    pub punctual: Vec<u8>,
    /// By instance and mesh, sorted: surfaces that emit or are unlit.
    pub surfaces: Vec<([u32; 2], u8)>,
    /// By index of an area light.
    area: Vec<u8>,
}

impl LightLayerTable {
    /// The same with the layers of these area lights.
    pub fn with_area(mut self, lights: &Lights) -> Self {
        let all = lights.area.iter().flat_map(|area| area.surfaces());
        self.area = all.map(|surface| self.surface(surface)).collect();
        self
    }

    /// Of an instance and a mesh.
    fn surface(&self, surface: [u32; 2]) -> u8 {
        self.surfaces.binary_search_by_key(&surface, |(own, _)| *own).map_or(0, |i| self.surfaces[i].1)
    }

    /// Of the surface that a ray hit.
    pub fn hit(&self, hit: Primitive) -> u8 {
        self.surface([hit.instance, hit.mesh])
    }

    /// Of a light that a light sample has chosen.
    #[inline]
    pub fn sampled(&self, light: LightNumber) -> u8 {
        let layers = match light.kind() {
            LightKind::Environment => return self.environment,
            LightKind::Area => &self.area,
            LightKind::Punctual | LightKind::Sized => &self.punctual,
        };
        layers.get((light.0 >> LightNumber::BITS) as usize).copied().unwrap_or(0)
    }
}
