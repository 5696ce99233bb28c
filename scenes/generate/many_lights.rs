//! Six poles around a mast, garlands of small bulbs between them, and things below to be lit by all of them: hundreds
//! of emitters of equal strength, so that the choice of an area light is the hard part.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3, dvec3};

use crate::glb::{Glb, Material, Placement};
use crate::mesh::{cuboid, floor, icosphere, lathe, profile_spline, rounded_box, sphere, torus, tube};

const BULB_RADIUS: f64 = 0.032;

/// A hanging wire's points.
fn garland(from: DVec3, to: DVec3, sag: f64, pieces: u32) -> Vec<DVec3> {
    (0..=pieces)
        .map(|i| f64::from(i) / f64::from(pieces))
        .map(|t| from.lerp(to, t) - DVec3::Y * 4.0 * sag * t * (1.0 - t))
        .collect()
}

pub fn scene() -> Glb {
    let mut glb = Glb::default();
    let tints = [
        ("bulb, amber", [1.0, 0.56, 0.20]),
        ("bulb, white", [1.0, 0.80, 0.58]),
        ("bulb, red", [1.0, 0.16, 0.08]),
        ("bulb, green", [0.30, 0.95, 0.35]),
        ("bulb, blue", [0.22, 0.42, 1.0]),
    ];
    let bulb = icosphere(1);
    let bulb = glb
        .geometry(&crate::mesh::Mesh { positions: bulb.positions.iter().map(|p| *p * BULB_RADIUS).collect(), ..bulb });
    let bulbs: Vec<usize> = tints
        .into_iter()
        .map(|(name, tint)| {
            let emitter = glb.material(&Material::emitter(name, tint.map(|c| c * 45.0)));
            glb.mesh(name, &[(&bulb, emitter)])
        })
        .collect();
    let iron = glb.material(&Material::metal("iron", [0.30, 0.29, 0.28], 0.45));
    let wire = glb.material(&Material::dielectric("wire", [0.02, 0.02, 0.02], 0.5));

    let top = dvec3(0.0, 3.1, 0.0);
    let pole = |i: u32| {
        let (sin, cos) = (TAU * (f64::from(i) + 0.5) / 6.0).sin_cos();
        dvec3(3.3 * cos, 2.3, 3.3 * sin)
    };
    let mut lines = Vec::new();
    for i in 0..6 {
        lines.push(garland(top, pole(i), 0.45, 22));
        lines.push(garland(pole(i), pole(i + 1), 0.35, 22));
    }
    let mut turn = 0;
    for line in &lines {
        glb.object("garland", &tube(line, 5, false, |_| 0.006), wire);
        for p in &line[1..line.len() - 1] {
            // Two of three are warm.
            let kind = [0, 1, 2, 0, 1, 3, 1, 0, 4][turn % 9];
            turn += 1;
            glb.instance(bulbs[kind], &Placement::at(*p - DVec3::Y * (BULB_RADIUS + 0.004)));
        }
    }
    for foot in (0..6).map(pole).chain([top]) {
        glb.object("pole", &tube(&[foot.with_y(0.0), foot + DVec3::Y * 0.05], 12, false, |_| 0.035), iron);
    }

    let stone = glb.material(&Material::dielectric("stone", [0.30, 0.28, 0.26], 0.75));
    let marble = glb.material(&Material::dielectric("marble", [0.72, 0.69, 0.64], 0.22));
    let brass = glb.material(&Material::metal("brass", [0.86, 0.67, 0.36], 0.24));
    let steel = glb.material(&Material::metal("steel", [0.62, 0.61, 0.59], 0.10));
    let glaze = glb.material(&Material::dielectric("blue glaze", [0.03, 0.10, 0.20], 0.08));
    glb.object("ground", &floor(9.0), stone);
    glb.object("plinth", &rounded_box(dvec3(1.3, 0.5, 1.3), 0.04, 3).translated(dvec3(0.0, 0.25, 0.0)), marble);
    let urn = profile_spline(
        &[(0.0, 0.5), (0.24, 0.5), (0.25, 0.54), (0.10, 0.62), (0.12, 0.70), (0.36, 1.0), (0.40, 1.22), (0.24, 1.42)],
        6,
    );
    let neck = profile_spline(&[(0.24, 1.42), (0.19, 1.5), (0.28, 1.62), (0.25, 1.62), (0.16, 1.5), (0.0, 1.4)], 6);
    glb.object("urn", &lathe(&[urn, neck[1..].to_vec()].concat(), 64, 50.0), glaze);
    let ball = glb.geometry(&sphere(1.0, 36));
    glb.shared("brass ball", &ball, brass, &Placement::scaled(dvec3(-1.35, 0.34, 0.9), 0.34));
    glb.shared("steel ball", &ball, steel, &Placement::scaled(dvec3(1.15, 0.26, 1.25), 0.26));
    let ring = torus(0.34, 0.11, 64, 20).rotated(DQuat::from_rotation_x(1.15)).translated(dvec3(1.75, 0.42, -0.25));
    glb.object("ring", &ring, brass);
    for (i, size) in [0.62, 0.46, 0.32].into_iter().enumerate() {
        let y = [0.31, 0.85, 1.24][i];
        let block = cuboid(DVec3::splat(size)).rotated(DQuat::from_rotation_y(0.5 + 0.7 * i as f64));
        glb.object("block", &block.translated(dvec3(-1.7, y, -0.75)), stone);
    }
    glb.camera("camera", dvec3(1.1, 1.75, 7.6), dvec3(0.0, 1.28, 0.0), 33.0, 16.0 / 9.0);
    glb
}
