//! The camera of a render and its lens.

use super::RenderSettings;
use super::lens::{Aperture, Focus};
use crate::integrator::data::camera::Lens;
use crate::integrator::{CameraRays, PreparedScene};
use crate::lanes::{F, U};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::scene::{Camera, Projection, Scene};
use crate::{Error, Result};

/// Height of the film in metres: that of 35 mm stills.
const FILM_HEIGHT: f64 = 0.024;

/// The camera of a render with these settings.
pub fn camera(scene: &Scene, settings: &RenderSettings) -> CameraRays {
    camera_of_size(scene, settings, [settings.width, settings.height])
}

/// The same view as a picture of another width and height.
pub fn camera_of_size(scene: &Scene, settings: &RenderSettings, [width, height]: [u32; 2]) -> CameraRays {
    let camera = scene.camera(settings.camera, width, height);
    let clip = camera.clip.filter(|_| settings.clip);
    CameraRays::new(&Camera { clip, ..camera }, width, height)
}

/// The lens of a render with these settings; `None` for a pinhole.
///
/// # Errors
/// [`Error::Usage`] for a panorama and a fisheye, which have no focal plane, for an f-stop of an orthographic camera, which has no
/// focal length, and for automatic focus where the middle of the picture shows nothing.
pub fn lens(scene: &PreparedScene, settings: &RenderSettings) -> Result<Option<Lens>> {
    let Some(requested) = settings.lens else { return Ok(None) };
    let RenderSettings { camera: index, width, height, .. } = *settings;
    let placed = scene.scene.camera(index, width, height);
    let radius = match (requested.aperture, placed.projection) {
        (_, Projection::Panorama) => {
            return Err(Error::Usage("--aperture: a panorama has no focal plane: render it without".into()));
        }
        (_, Projection::Calibrated(of)) if of.fisheye => {
            return Err(Error::Usage("--aperture: a fisheye has no focal plane: render it without".into()));
        }
        (Aperture::Radius(radius), _) => radius,
        (Aperture::Stop(stop), Projection::Perspective { yfov }) => {
            0.5 * FILM_HEIGHT / (0.5 * f64::from(yfov)).tan() / (2.0 * stop)
        }
        (Aperture::Stop(stop), Projection::Calibrated(of)) => FILM_HEIGHT * of.fl_y / of.h / (2.0 * stop),
        (Aperture::Stop(_), Projection::Orthographic { .. }) => {
            let why =
                "--aperture: an orthographic camera has no focal length, and so no f-stop: give a radius in metres";
            return Err(Error::Usage(why.into()));
        }
    };
    let focus = match requested.focus {
        Focus::Distance(distance) => distance as f32,
        Focus::Auto => {
            let [x, y] = [width, height].map(|size| F::splat(0.5 * size as f32));
            let middle = F::splat(0.5);
            let camera = camera(&scene.scene, settings);
            let ray = camera.rays(x, y, middle);
            let (near, far) = camera.intervals(ray.1, middle);
            let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
            rays.open(1, scene.geometry.moves);
            rays.put(0, ray, far, U::ZERO, middle);
            rays.close(1);
            rays.tnear[0] = near.as_array()[0];
            scene.rays.closest_hits(&rays, RayOrder::Coherent, &mut hits);
            if hits.instance[0] == MISS {
                let why =
                    "--focus auto: the middle of the picture shows nothing to focus on: give a distance in metres";
                return Err(Error::Usage(why.into()));
            }
            match placed.projection {
                // The middle of the picture is not on the view axis.
                Projection::Calibrated(_) => -hits.t[0] * ray.1.lane(0).dot(placed.to_world.matrix3.z_axis.into()),
                _ => hits.t[0],
            }
        }
    };
    Ok(Some(Lens { radius: radius as f32, focus, blades: requested.blades }))
}
