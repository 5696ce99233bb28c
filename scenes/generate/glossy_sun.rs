//! A trefoil knot of glossy copper and two balls on a diffuse ground, under a sky whose small sun carries most of the
//! light: light sampling wins on the ground, BSDF sampling in the smoothest reflections.

use std::f64::consts::TAU;

use glam::{DQuat, dvec3};

use crate::glb::{Glb, Material, Placement};
use crate::mesh::{floor, sphere, tube};
use crate::pictures::Sky;

pub const SKY: Sky = Sky {
    sun: dvec3(-0.62, 0.52, 0.35),
    sun_radius: 0.9,
    sun_radiance: dvec3(4600.0, 4000.0, 3200.0),
    zenith: dvec3(0.14, 0.29, 0.62),
    horizon: dvec3(0.62, 0.74, 0.88),
    ground: dvec3(0.17, 0.15, 0.13),
    glow: dvec3(0.42, 0.34, 0.22),
};

pub fn scene() -> Glb {
    let mut glb = Glb::default();
    let copper = glb.material(&Material::metal("copper", [0.93, 0.60, 0.46], 0.22));
    let black = glb.material(&Material::dielectric("black lacquer", [0.012, 0.012, 0.014], 0.12));
    let chalk = glb.material(&Material::lambert("chalk", [0.72, 0.70, 0.66]));
    let ground = glb.material(&Material::lambert("ground", [0.34, 0.31, 0.27]));
    let steps = 200;
    let path: Vec<_> = (0..steps)
        .map(|i| TAU * f64::from(i) / f64::from(steps))
        .map(|t| {
            let r = 2.0 + (3.0 * t).cos();
            dvec3(r * (2.0 * t).cos(), r * (2.0 * t).sin(), (3.0 * t).sin()) * 0.4
        })
        .collect();
    let knot = tube(&path, 28, true, |_| 0.215).rotated(DQuat::from_rotation_y(0.35));
    let lowest = knot.positions.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    glb.object("knot", &knot.translated(dvec3(0.0, -lowest, 0.0)), copper);
    let ball = glb.geometry(&sphere(1.0, 40));
    glb.shared("lacquered ball", &ball, black, &Placement::scaled(dvec3(1.75, 0.42, 0.75), 0.42));
    glb.shared("chalk ball", &ball, chalk, &Placement::scaled(dvec3(-1.55, 0.3, 0.95), 0.3));
    glb.object("ground", &floor(30.0), ground);
    glb.camera("camera", dvec3(0.5, 1.75, 5.6), dvec3(0.1, 0.98, 0.0), 31.0, 1.5);
    glb
}
