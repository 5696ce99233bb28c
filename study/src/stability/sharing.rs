//! Failure modes of path re-use: small scenes whose light arrives by other surfaces, rendered many times. All pixels of a picture
//! are in groups together.

use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::Balance;
use bismar::integrator::Reuse;
use bismar::render::Integrator;
use bismar::scene::build::{area_light, lambert, metal};
use bismar::scene::{Environment, Material, Scene};

use super::scenes::{Estimator, SIDE, SceneCase, ceiling, floor, plate};
use super::{Results, rendered};

const CASES: usize = 7;

/// The fractions of paths that go on with which `auto` chooses groups, and all.
pub(crate) fn estimators() -> [Estimator; 3] {
    let all = [4, 8, 16].map(|traced| Reuse { group: SIDE * SIDE, traced });
    all.map(|sizes| Estimator { name: sizes.to_string(), balance: Balance::Half, reuse: Some(sizes) })
}

/// A floor, and behind what is visible of it a wall, lit by a lamp of half width `w` that faces it from a distance `d`. No other
/// surface sees the lamp's front.
fn lit_wall(scene: &mut Scene, wall: Material, [w, d, y]: [f32; 3], radiance: f32) {
    floor(scene, [-3.0, 3.0], lambert(0.6));
    plate(scene, [-3.0, 0.0, -1.5], [6.0, 0.0, 0.0], [0.0, 3.0, 0.0], wall);
    plate(scene, [w, y - w, d - 1.5], [-2.0 * w, 0.0, 0.0], [0.0, 2.0 * w, 0.0], area_light(radiance));
}

fn cases() -> Result<[SceneCase; CASES]> {
    let black = || Material { double_sided: true, ..lambert(0.0) };
    let new = |mode, name, construct, scene, yfov| SceneCase::new(mode, name, construct, Integrator::Path, scene, yfov);
    let screened = "a wall lights the floor; a screen hides it from half of the pixels";
    let mut edge = Scene::default();
    lit_wall(&mut edge, lambert(0.8), [0.2, 0.3, 0.6], 10.0);
    plate(&mut edge, [-3.0, 0.0, -0.4], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], black());

    let mut firefly = Scene { environment: Some(Environment::constant([0.02; 3])), ..Default::default() };
    lit_wall(&mut firefly, lambert(0.8), [0.03, 0.03, 0.6], 2000.0);

    let mut corner = Scene::default();
    floor(&mut corner, [-3.0, 3.0], lambert(0.6));
    plate(&mut corner, [-3.0, 0.0, 0.0], [6.0, 0.0, 0.0], [0.0, 3.0, 0.0], lambert(0.8));
    ceiling(&mut corner, [0.0, 1.5, 1.0], 0.3, area_light(6.0));

    let lit = |wall: Material| {
        let mut scene = Scene::default();
        lit_wall(&mut scene, wall, [0.2, 0.3, 0.6], 10.0);
        scene
    };
    let black_from = |x: f32, [width, depth]: [f32; 2]| {
        let mut scene = lit(lambert(0.8));
        plate(&mut scene, [x, 0.001, depth - 0.3], [width, 0.0, 0.0], [0.0, 0.0, -depth], black());
        scene
    };
    let (one_black, half_black) = (black_from(0.0, [0.25, 0.3]), black_from(0.0, [3.0, 3.0]));
    let varnished = lit(Material { clearcoat: 1.0, ..lambert(0.8) });
    Ok([
        new("F26", "edge of a shadow", screened, edge, 0.2)?,
        new("F27", "a firefly that is lent", "a tiny bright spot on a wall, and a dim environment", firefly, 0.2)?,
        new("F28", "corner", "two surfaces that meet in the middle of the picture light each other", corner, 0.1)?,
        new("F29", "one black pixel", "as F26 without the screen; one pixel is black", one_black, 0.3)?,
        new("F30", "black texels", "as F29; half of the pixels are black", half_black, 0.3)?,
        new("F31", "varnish", "as F29 without black; the wall has a smooth clear coat", varnished, 0.3)?,
        new("F32", "metal", "as F31; the wall is a metal of α = 0.1", lit(metal(0.1f32.sqrt())), 0.3)?,
    ])
}

/// Number of steps of [`measure`].
pub fn steps() -> usize {
    CASES * (estimators().len() + 1)
}

/// Measures all cases with `replicas` ≥ 2. Calls `done` after each of [`steps`]; `done` may stop the measurement with an
/// error, and must once `stop` is raised.
pub fn measure(replicas: u32, stop: &AtomicBool, done: &mut dyn FnMut() -> Result<()>) -> Result<Results> {
    let mut modes = Vec::new();
    for case in cases()? {
        modes.push(rendered(&case, &estimators(), replicas, stop, done)?);
    }
    Ok(Results::new(replicas, modes, Vec::new(), 0))
}
