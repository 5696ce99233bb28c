//! Cameras.

use std::sync::Arc;

use glam::{Affine3A, Mat3, Vec3};

use super::{Calibration, Framing, Motion};

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Vertical field of view, independent of the picture's aspect.
    Perspective {
        /// Radians, in (0, π).
        yfov: f32,
    },
    /// Half extents in metres. The picture's aspect changes the horizontal one only.
    Orthographic {
        /// Half width.
        xmag: f32,
        /// Half height.
        ymag: f32,
    },
    /// All directions, as an equirectangular picture: the longitude about the camera's y axis goes from −π at the left side
    /// over 0 (the view axis) in the middle to π, the latitude from π/2 at the top to −π/2.
    Panorama,
    /// Principal point, focal lengths and distortion as they were measured, [sound](Calibration::fault). A picture of another
    /// size shows the same, with both axes scaled.
    Calibrated(Calibration),
}

/// A camera that looks along its local −z axis, with +y up.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Name, for `--camera`.
    pub name: String,
    pub projection: Projection,
    /// Width over height if the file states it; sets the default picture size.
    pub aspect: Option<f32>,
    /// Camera to world at the picture's own time: rotation and translation without scale.
    pub to_world: Affine3A,
    /// Motion while the shutter is open; `None` if the camera does not move.
    pub motion: Option<Arc<Motion>>,
    /// Camera to world one frame before and one after, for velocities; `None` if equal to `to_world` or not requested.
    pub adjacent_frames: Option<[Affine3A; 2]>,
    /// Points that the view is fitted to. If present, [`super::Scene::camera`] replaces `to_world` by the transform that
    /// fits the picture's aspect; set it to `None` to place this camera by hand.
    pub framing: Option<Arc<Framing>>,
    /// Clipping planes: the least and the largest depth along the view axis that the camera sees, in metres, the latter
    /// infinite where the file has none. Shadows and mirrors see all. `None` for cameras without.
    pub clip: Option<[f32; 2]>,
    /// Why the file's camera cannot be used; the projection is then a stand-in.
    pub fault: Option<Arc<str>>,
}

impl Camera {
    /// Name of [`Self::panorama`].
    pub const PANORAMA: &str = "panorama";

    /// A camera that does not move, by its name, projection, and transform from camera to world (rotation and translation).
    pub fn new(name: impl Into<String>, projection: Projection, to_world: Affine3A) -> Self {
        Self {
            name: name.into(),
            projection,
            aspect: None,
            to_world,
            motion: None,
            adjacent_frames: None,
            framing: None,
            clip: None,
            fault: None,
        }
    }

    /// A camera named `camera` at `eye` that looks at `target` (world space, metres), with a vertical field of view in
    /// radians. The world's +y is up in the picture; +z if the camera looks within about 8° of straight up or down.
    pub fn look_at(eye: Vec3, target: Vec3, yfov: f32) -> Self {
        let up = if (target - eye).normalize().y.abs() > 0.99 { Vec3::Z } else { Vec3::Y };
        let z = (eye - target).normalize();
        let x = up.cross(z).normalize();
        let to_world = Affine3A::from_mat3_translation(Mat3::from_cols(x, z.cross(x), z), eye);
        Self::new("camera", Projection::Perspective { yfov }, to_world)
    }

    /// A panorama from `eye` (world space, metres), named [`Self::PANORAMA`]. Its picture has the orientation of an
    /// environment map: +x in the middle, −z at a quarter of the width, +y at the top ([`super::Environment`]).
    pub fn panorama(eye: Vec3) -> Self {
        let to_world = Affine3A::from_mat3_translation(Mat3::from_cols(Vec3::Z, Vec3::Y, Vec3::NEG_X), eye);
        Self { aspect: Some(2.0), ..Self::new(Self::PANORAMA, Projection::Panorama, to_world) }
    }

    /// Width over height that suits the projection, if the file states it or the projection has one; finite and above 0.
    pub fn natural_aspect(&self) -> Option<f32> {
        let aspect = self.aspect.or(match self.projection {
            Projection::Orthographic { xmag, ymag } => Some((xmag / ymag).abs()),
            Projection::Panorama => Some(2.0),
            Projection::Calibrated(of) => Some((of.w / of.h) as f32),
            Projection::Perspective { .. } => None,
        });
        aspect.filter(|aspect| aspect.is_finite() && *aspect > 0.0)
    }

    /// The view that shows all points of `framing`, named [`Framing::NAME`]; fitted to a square picture until
    /// [`super::Scene::camera`] is asked for another aspect.
    pub fn framed(framing: Framing) -> Self {
        let projection = Projection::Perspective { yfov: Framing::YFOV as f32 };
        let camera = Self::new(Framing::NAME, projection, framing.to_world(1.0));
        Self { framing: Some(Arc::new(framing)), ..camera }
    }
}
