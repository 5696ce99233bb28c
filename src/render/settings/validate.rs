//! Checks of settings before a render begins.

use super::MAX_SIDE;
use super::lens::{Aperture, Focus, LensSettings, is_optical};
use super::{RenderSettings, StudyOptions};
use crate::integrator::data::dimensions::MAX_SEGMENTS;
use crate::render::settings::part::TILE;
use crate::scene::Scene;
use crate::{Error, Result};

fn check(holds: bool, why: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::Usage(why())) }
}

impl RenderSettings {
    /// Checks that `scene` can be rendered with these settings.
    ///
    /// # Errors
    /// [`Error::Usage`] with the value that is out of its range: a camera that does not exist; a size of 0 or above
    /// [`MAX_SIDE`]; a crop window that is empty or outside of the picture; counts of 0; limits and goals that are not
    /// positive and finite; a pilot's fraction out of (0, 1); `second-order` without `spp`; a lens without an opening; a
    /// part that does not exist.
    pub fn validate(&self, scene: &Scene) -> Result<()> {
        let Self { camera, width, height, max_depth, spp, min_spp, pilot, .. } = *self;
        let Self { time, noise, clamp_direct, clamp_indirect, .. } = *self;
        let cameras = scene.cameras.len();
        check(camera < cameras, || format!("camera {camera} does not exist: the scene has {cameras}, counted from 0"))?;
        check([width, height].iter().all(|n| (1..=MAX_SIDE).contains(n)), || {
            format!("the picture's size is {width}x{height}: each side must be 1 to {MAX_SIDE} pixels")
        })?;
        if let Some([x0, y0, x1, y1]) = self.crop {
            check(x0 < x1 && y0 < y1, || format!("the crop window {x0},{y0},{x1},{y1} is empty"))?;
            check(x1 <= width && y1 <= height, || {
                format!("the crop window {x0},{y0},{x1},{y1} is not inside the picture of {width}x{height} pixels")
            })?;
        }
        check((1..=MAX_SEGMENTS).contains(&max_depth), || {
            format!("max_depth is {max_depth}: it must be 1 to {MAX_SEGMENTS}")
        })?;
        for (name, value, min) in [("spp", spp, 1), ("min_spp", min_spp, 2)] {
            let holds = value.is_none_or(|n| n >= min);
            check(holds, || format!("{name} is {}: it must be at least {min}", value.unwrap_or_default()))?;
        }
        for (name, value) in
            [("time", time), ("noise", noise), ("clamp_direct", clamp_direct), ("clamp_indirect", clamp_indirect)]
        {
            let holds = value.is_none_or(|x| x.is_finite() && x > 0.0);
            check(holds, || format!("{name} is {}: it must be finite and above 0", value.unwrap_or_default()))?;
        }
        check(pilot.is_none_or(|pilot| pilot > 0.0 && pilot < 1.0), || {
            format!("pilot is {}: it must be between 0 and 1, both excluded", pilot.unwrap_or_default())
        })?;
        check(spp.is_some() || !self.balance.method().needs_goal(), || {
            let name = self.balance.name();
            format!(
                "{name} needs spp: its pilot is a fraction of all samples, so their number must be known beforehand"
            )
        })?;
        check(self.part.is_none_or(|part| (1..=part.of).contains(&part.number)), || {
            format!("part {} does not exist", self.part.map_or(String::new(), |part| part.to_string()))
        })?;
        self.lens.map_or(Ok(()), |lens| lens.validate())
    }
}

impl LensSettings {
    fn validate(&self) -> Result<()> {
        let (Aperture::Stop(aperture) | Aperture::Radius(aperture)) = self.aperture;
        check(is_optical(aperture), || format!("the aperture is {aperture}: it must be from 1e-9 to 1e9"))?;
        if let Focus::Distance(distance) = self.focus {
            check(is_optical(distance), || format!("the focus distance is {distance} m: it must be from 1e-9 to 1e9"))?;
        }
        check(self.blades == 0 || (3..=32).contains(&self.blades), || {
            format!("{} blades: a lens has 0, which makes it round, or 3 to 32", self.blades)
        })
    }
}

impl StudyOptions {
    /// Checks that these options fit a picture of these settings.
    ///
    /// # Errors
    /// [`Error::Usage`] for tiles outside of the picture.
    pub(in crate::render) fn validate(&self, settings: &RenderSettings) -> Result<()> {
        let [columns, rows] = [settings.width, settings.height].map(|n| n.div_ceil(TILE));
        let mut tiles = self.tiles.iter().flat_map(|tiles| tiles.iter());
        check(tiles.all(|[x, y]| *x < columns && *y < rows), || "a tile is outside of the picture".into())
    }
}
