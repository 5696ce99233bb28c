//! What a path has met before a ray, as far as it decides what the ray sees.

use super::transport::{MAX_GLASS_BOUNCES, Transport};

/// Density per steradian, of a sample of the BSDF (whatever guides it), from which a ray counts as the mirror image of the ray
/// before. It is that of a lobe that covers about 0.1 sr: roughness below about 0.3. Of the reflections of a perfect mirror
/// (α 0.001), 1 % have a lower density; of a diffuse surface, none has a higher one.
pub const MIRROR_PDF: f32 = 10.0;

const MIRROR_IMAGE: u8 = 1;
const AFTER_ROUGH: u8 = 2;
const REFRACTED: u8 = 4;
const ROUGH: u8 = 8;

/// The history of a path up to a ray. Scenes in which nothing depends on it ([`is_tracked`]) have none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayHistory {
    flags: u8,
    /// Bounces of the path that `max_depth` does not count: light that crosses smooth glass or is mirrored by it, in scenes
    /// with bodies of it. Light needs two of them to pass a pane and four to pass a bottle.
    glass_bounces: u8,
}

/// A direction that a vertex samples.
#[derive(Debug, Clone, Copy)]
pub struct Bounce {
    /// Density per solid angle: of the mixture with a guiding field.
    pub pdf: f32,
    /// The same of the BSDF.
    pub bsdf_pdf: f32,
    /// Does it cross the surface?
    pub beyond: bool,
    /// Is the surface smooth glass? Read in scenes with bodies of it, where the direction crosses it or is a mirror image.
    pub smooth: bool,
}

/// Does anything depend on the history of paths: back faces, unlit surfaces (which give no light), bodies of smooth glass?
pub fn is_tracked(transport: &Transport) -> bool {
    let materials = transport.materials;
    transport.culls() || materials.has_unlit || materials.has_smooth_bodies
}

impl RayHistory {
    /// That of camera rays.
    pub const CAMERA: Self = Self { flags: MIRROR_IMAGE, glass_bounces: 0 };

    /// After another bounce.
    pub fn after(self, transport: &Transport, bounce: &Bounce) -> Self {
        let mirrored = self.is_mirror_image() && bounce.bsdf_pdf >= MIRROR_PDF;
        let mirror_image = if mirrored { MIRROR_IMAGE } else { 0 };
        if !transport.materials.has_smooth_bodies {
            return Self { flags: mirror_image, glass_bounces: 0 };
        }
        let through_glass = bounce.smooth && (bounce.beyond || bounce.pdf >= MIRROR_PDF);
        let uncounted = through_glass && u32::from(self.glass_bounces) < MAX_GLASS_BOUNCES;
        let straight = match bounce.pdf < MIRROR_PDF {
            true => AFTER_ROUGH | ROUGH,
            false if bounce.smooth && bounce.beyond && self.is_after_rough() => AFTER_ROUGH | REFRACTED,
            false => self.flags & (AFTER_ROUGH | REFRACTED),
        };
        Self {
            flags: mirror_image | if transport.passes_bodies() { straight } else { 0 },
            glass_bounces: self.glass_bounces + u8::from(uncounted),
        }
    }

    /// Has it met nothing but smooth glass before a ray at `depth`? True of camera rays.
    pub fn has_met_only_glass(self, depth: u32) -> bool {
        u32::from(self.glass_bounces) == depth
    }

    /// Is it a camera ray or a mirror image of one?
    pub fn is_mirror_image(self) -> bool {
        self.flags & MIRROR_IMAGE != 0
    }

    /// Has the path had a vertex whose direction was rough (of a density below [`MIRROR_PDF`])? False unless shadow rays pass
    /// bodies of glass, as the next two are.
    pub fn is_after_rough(self) -> bool {
        self.flags & AFTER_ROUGH != 0
    }

    /// Is this ray's direction rough?
    pub fn is_rough(self) -> bool {
        self.flags & ROUGH != 0
    }

    /// Has the path been refracted since it had a rough direction? The light at its end then belongs to light samples of an
    /// earlier vertex.
    pub fn is_refracted(self) -> bool {
        self.flags & REFRACTED != 0
    }

    /// Does a path with this history scatter at `depth`?
    pub fn scatters(self, transport: &Transport, depth: u32) -> bool {
        depth + 1 - u32::from(self.glass_bounces) < transport.max_depth
    }
}
