//! What a path has met before a ray, as far as it decides what the ray sees.

use wide::bytemuck::cast;

use super::transport::{MAX_GLASS_BOUNCES, Transport};
use crate::lanes::{F, U, are};

/// Density per steradian, of a sample of the BSDF (whatever guides it), from which a ray counts as the mirror image of the ray
/// before. It is that of a lobe that covers about 0.1 sr: roughness below about 0.3. Of the reflections of a perfect mirror
/// (α 0.001), 1 % have a lower density; of a diffuse surface, none has a higher one.
pub const MIRROR_PDF: f32 = 10.0;

const MIRROR_IMAGE: u32 = 1;
const AFTER_ROUGH: u32 = 2;
const REFRACTED: u32 = 4;
const ROUGH: u32 = 8;
/// One bounce at glass.
const GLASS_BOUNCE: u32 = 1 << 8;

/// The history of a path up to a ray: flags and, in units of `GLASS_BOUNCE`, the bounces that `max_depth` does not count. These
/// are of light that crosses smooth glass or is mirrored by it, in scenes with bodies of it: two to pass a pane, four to pass a
/// bottle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RayHistory(pub u32);

/// Eight directions that vertices sample.
#[derive(Debug, Clone, Copy)]
pub struct Bounces {
    /// Densities per solid angle: of the mixture with a guiding field.
    pub pdf: F,
    /// The same of the BSDF.
    pub bsdf_pdf: F,
    /// Mask: the direction crosses the surface. Read, as the next is, in scenes with bodies of smooth glass.
    pub beyond: F,
    /// Mask: the surface is smooth glass; read where the direction crosses it or is a mirror image.
    pub smooth: F,
}

impl RayHistory {
    /// That of camera rays.
    pub const CAMERA: Self = Self(MIRROR_IMAGE);

    /// Those of eight paths after another bounce.
    #[inline(always)]
    pub fn after(before: U, transport: &Transport, bounces: &Bounces) -> U {
        let Bounces { pdf, bsdf_pdf, beyond, smooth } = *bounces;
        let set = |mask: F, bits: u32| cast::<F, U>(mask) & U::splat(bits);
        let mirror_image = before & set(bsdf_pdf.simd_ge(F::splat(MIRROR_PDF)), MIRROR_IMAGE);
        if !transport.materials.has_smooth_bodies {
            return mirror_image;
        }
        let rough = pdf.simd_lt(F::splat(MIRROR_PDF));
        let through_glass = smooth & (beyond | !rough);
        let glass_bounces = before & U::splat(!(GLASS_BOUNCE - 1));
        let is_full = are(glass_bounces, MAX_GLASS_BOUNCES * GLASS_BOUNCE);
        let history = mirror_image | (glass_bounces + set(through_glass & !is_full, GLASS_BOUNCE));
        if !transport.passes_bodies() {
            return history;
        }
        let refracted = smooth & beyond & Self::are_after_rough(before);
        let kept = (before & U::splat(AFTER_ROUGH | REFRACTED)) | set(refracted, REFRACTED);
        history | cast::<F, U>(rough).select(U::splat(AFTER_ROUGH | ROUGH), kept)
    }

    /// Mask of the histories that are [mirror images](Self::is_mirror_image).
    #[inline(always)]
    pub(crate) fn are_mirror_images(histories: U) -> F {
        are(histories & U::splat(MIRROR_IMAGE), MIRROR_IMAGE)
    }

    /// Mask of the histories [after a rough vertex](Self::is_after_rough).
    #[inline(always)]
    pub(crate) fn are_after_rough(histories: U) -> F {
        are(histories & U::splat(AFTER_ROUGH), AFTER_ROUGH)
    }

    /// Has it met nothing but smooth glass before a ray at `depth`? True of camera rays.
    pub fn has_met_only_glass(self, depth: u32) -> bool {
        self.glass_bounces() == depth
    }

    /// Is it a camera ray or a mirror image of one?
    pub fn is_mirror_image(self) -> bool {
        self.0 & MIRROR_IMAGE != 0
    }

    /// Has the path had a vertex whose direction was rough (of a density below [`MIRROR_PDF`])? False unless shadow rays pass
    /// bodies of glass, as the next two are.
    pub fn is_after_rough(self) -> bool {
        self.0 & AFTER_ROUGH != 0
    }

    /// Is this ray's direction rough?
    pub fn is_rough(self) -> bool {
        self.0 & ROUGH != 0
    }

    /// Has the path been refracted since it had a rough direction? The light at its end then belongs to light samples of an
    /// earlier vertex.
    pub fn is_refracted(self) -> bool {
        self.0 & REFRACTED != 0
    }

    /// Does a path with this history scatter at `depth`?
    pub fn scatters(self, transport: &Transport, depth: u32) -> bool {
        depth + 1 - self.glass_bounces() < transport.max_depth
    }

    fn glass_bounces(self) -> u32 {
        self.0 / GLASS_BOUNCE
    }
}
