//! Settings of a request: what its options ask of each other, and camera and resolution, which depend on the scene.

use super::request::RenderRequest;
use crate::film::Aov;
use crate::render::{Balance, Choice, RenderSettings, Technique, tile_positions};
use crate::scene::{Camera, Framing, Projection, Scene, choose};
use crate::{Error, Result};

impl RenderRequest {
    /// Checks what options ask of each other. `has_frames`: it is what the frames of a sequence have in common.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self, has_frames: bool) -> Result<()> {
        let wrong = |why: String| Err(Error::Usage(why));
        let name = self.balance.name();
        match (self.balance.method().needs_goal(), self.spp, self.pilot) {
            (true, None, _) => {
                let why = "its pilot is a share of all samples, so their number must be known in advance";
                return wrong(format!("--balance {name} needs --spp: {why}"));
            }
            (false, _, Some(_)) => {
                let with_pilot = Balance::all().iter().filter(|b| b.method().needs_goal()).map(|b| b.name());
                let with_pilot = with_pilot.collect::<Vec<_>>().join(" or ");
                return wrong(format!(
                    "--pilot needs --balance {with_pilot}; {name} has no pilot whose size can be set"
                ));
            }
            _ => {}
        }
        let on = |technique: &Technique| self.techniques.choices[*technique] == Some(Choice::On);
        let refused = Technique::ALL.iter().find(|it| self.noise.is_some() && on(it) && !it.row().suits_noise_goal);
        if let Some(refused) = refused {
            let flag = refused.row().flag;
            return wrong(format!(
                "--{flag} cannot be used with --noise, which gives each tile the paths that it needs"
            ));
        }
        if self.seed_per_frame == Some(true) && !has_frames && self.selection.frame.is_none() {
            return wrong("--seed-per-frame needs a frame: --frames or --frame".into());
        }
        // `--aov all` leaves out what cannot be written.
        let velocity = self.aov.len() < Aov::ALL.len() && self.aov.contains(&Aov::Velocity);
        self.selection.check(has_frames || self.selection.is_posed(), velocity, self.rays)?;
        self.view.check()
    }
}

/// Render settings of a request, completed by the scene.
///
/// # Errors
/// [`Error::Data`] for a faulty camera; [`Error::Usage`] for an unknown one, and more parts than tiles; those of [`RenderSettings::validate`].
pub fn settings(request: &RenderRequest, scene: &Scene) -> Result<RenderSettings> {
    // The camera of `Loaded::placed` is the last one.
    let camera = match request.orbit.is_some() || request.placed.is_some() {
        true => scene.cameras.len() - 1,
        false => camera(&scene.cameras, request.camera.as_deref())?,
    };
    if let Some(fault) = &scene.cameras[camera].fault {
        return Err(Error::Data(format!("{}: {fault}", request.scene.display())));
    }
    let (width, height) = request.size.map_or_else(|| size(&scene.cameras[camera]), |s| (s.0, s.1));
    request.check(false)?;
    let settings = RenderSettings { camera, width, height, ..request.settings() };
    settings.validate(scene)?;
    if let Some(part) = settings.part
        && tile_positions(&settings).is_empty()
    {
        return Err(Error::Usage(format!("--part {part}: the picture has fewer tiles than parts; give fewer parts")));
    }
    Ok(settings)
}

/// Index of the camera that `--camera` selects: by name, else by index; without `--camera` the first.
///
/// # Errors
/// [`Error::Usage`], which lists the cameras.
pub fn camera(cameras: &[Camera], wanted: Option<&str>) -> Result<usize> {
    match wanted {
        Some(wanted) => {
            choose("camera", wanted, &cameras.iter().map(|c| c.name.clone()).collect::<Vec<_>>()).map_err(|error| {
                let (framed, panorama) = (Framing::NAME, Camera::PANORAMA);
                Error::Usage(format!("{error}\n  or {framed}, which shows the whole scene, or {panorama}"))
            })
        }
        None if cameras.is_empty() => Err(Error::Bug("a scene without a camera".into())),
        None => Ok(0),
    }
}

/// Index of the camera of the file whose view decides whether the scene's own light suffices: that of `--camera`; the first
/// for cameras that are not of the file.
/// Errors: [`Error::Usage`], which lists the cameras.
pub(crate) fn camera_of_file(cameras: &[Camera], request: &RenderRequest) -> Result<usize> {
    let wanted = request.camera.as_deref().filter(|_| !is_panorama(cameras, request));
    let sound = cameras.iter().position(|camera| camera.fault.is_none());
    camera(cameras, wanted).map(|index| sound.filter(|_| wanted.is_none()).unwrap_or(index))
}

/// Whether the camera is a panorama that the scene does not hold.
pub(crate) fn is_panorama(cameras: &[Camera], request: &RenderRequest) -> bool {
    request.camera.as_deref() == Some(Camera::PANORAMA) && cameras.iter().all(|camera| camera.name != Camera::PANORAMA)
}

/// The panorama of `--camera panorama`: from the first camera of the file, or from the centre of the scene if it has none.
pub fn panorama(scene: &Scene) -> Camera {
    let first = scene.cameras.first().filter(|camera| camera.framing.is_none());
    let eye = first.map(|camera| camera.to_world.translation.into());
    Camera::panorama(eye.unwrap_or_else(|| scene.enclosing_sphere().0.as_vec3()))
}

/// Resolution in pixels for a camera without an aspect ratio.
pub const DEFAULT_SIZE: (u32, u32) = (960, 540);

/// Default resolution in pixels: that of a calibrated camera, else 960 wide, with the camera's aspect ratio or 16:9.
pub fn size(camera: &Camera) -> (u32, u32) {
    match camera.projection {
        Projection::Calibrated(of) => (of.w as u32, of.h as u32),
        _ => size_of_aspect(camera.natural_aspect()),
    }
}

/// Default resolution of a camera with this width over height.
pub(crate) fn size_of_aspect(aspect: Option<f32>) -> (u32, u32) {
    const WIDTH: u32 = 960;
    let aspect = aspect.filter(|a| a.is_finite() && *a > 0.0).unwrap_or(16.0 / 9.0);
    (WIDTH, (WIDTH as f32 / aspect).round().clamp(1.0, 16.0 * WIDTH as f32) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras(names: &[&str]) -> Vec<Camera> {
        let camera =
            |name: &&str| Camera { name: name.to_string(), ..Camera::look_at(glam::Vec3::Z, glam::Vec3::ZERO, 1.0) };
        names.iter().map(camera).collect()
    }

    #[test]
    fn a_camera_is_found_by_name_then_by_index() {
        let list = cameras(&["front", "2", "side", "side"]);
        assert_eq!(camera(&list, None).unwrap(), 0);
        assert_eq!(camera(&list, Some("front")).unwrap(), 0);
        assert_eq!(camera(&list, Some("2")).unwrap(), 1);
        assert_eq!(camera(&list, Some("3")).unwrap(), 3);
        let unknown = camera(&list, Some("top")).unwrap_err();
        assert_eq!(unknown.exit_code(), 64);
        assert!(unknown.to_string().contains("0  front"), "{unknown}");
        assert!(camera(&list, Some("side")).unwrap_err().to_string().contains("choose by index"));
        assert_eq!(camera(&list, Some("4")).unwrap_err().exit_code(), 64);
    }

    #[test]
    fn the_default_size_follows_the_cameras_aspect() {
        let mut one = cameras(&["a"]).remove(0);
        assert_eq!(size(&one), (960, 540));
        one.aspect = Some(1.5);
        assert_eq!(size(&one), (960, 640));
        one.aspect = Some(f32::NAN);
        assert_eq!(size(&one), (960, 540));
        one.aspect = None;
        one.projection = Projection::Orthographic { xmag: 1.0, ymag: 2.0 };
        assert_eq!(size(&one), (960, 1920));
        assert_eq!(size(&Camera::panorama(glam::Vec3::ZERO)), (960, 480));
    }
}
