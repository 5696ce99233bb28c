//! A rolling meadow: one mesh each of a tuft, a flower and a stone, placed thousands of times.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3, dvec3};

use crate::glb::{Glb, Material, Placement};
use crate::mesh::{Mesh, icosphere, stone, tube};
use crate::pictures::Sky;
use crate::random::{Random, fractal};

const WIDTH: f64 = 44.0;
const NEAR: f64 = 6.0;
const FAR: f64 = -48.0;

pub const SKY: Sky = Sky {
    sun: dvec3(-0.75, 0.30, -0.62),
    sun_radius: 1.1,
    sun_radiance: dvec3(3300.0, 2300.0, 1350.0),
    zenith: dvec3(0.13, 0.25, 0.52),
    horizon: dvec3(0.78, 0.70, 0.62),
    ground: dvec3(0.10, 0.10, 0.07),
    glow: dvec3(0.85, 0.52, 0.24),
};

fn height(x: f64, z: f64) -> f64 {
    let hills = 0.9 * (0.16 * x + 0.5).sin() * (0.13 * z).cos() + 0.035 * (-z - 6.0).max(0.0);
    hills + 0.25 * (0.45 * x + 0.3 * z).sin() + 0.1 * (0.9 * z - 0.6 * x).sin()
}

fn upright(x: f64, z: f64) -> DVec3 {
    let e = 0.01;
    dvec3(height(x - e, z) - height(x + e, z), 2.0 * e, height(x, z - e) - height(x, z + e)).normalize()
}

fn ground() -> Mesh {
    let (columns, rows) = (72, 88);
    let mut mesh = Mesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let x = WIDTH * (f64::from(column) / f64::from(columns) - 0.5);
            let z = NEAR + (FAR - NEAR) * f64::from(row) / f64::from(rows);
            mesh.positions.push(dvec3(x, height(x, z), z));
            mesh.normals.push(upright(x, z));
        }
    }
    let n = columns as u32 + 1;
    for a in (0..rows as u32).flat_map(|row| (0..columns as u32).map(move |column| row * n + column)) {
        mesh.triangles.extend([[a, a + 1, a + n + 1], [a, a + n + 1, a + n]]);
    }
    mesh
}

/// A blade that bends outwards, about 1 high before its bend.
fn blade(random: &mut Random) -> Mesh {
    let turn = DQuat::from_rotation_y(random.between(0.0, TAU));
    let (lean, tall, wide) = (random.between(0.12, 0.75), random.between(0.55, 1.0), random.between(0.022, 0.04));
    let foot = dvec3(random.between(-0.16, 0.16), 0.0, random.between(-0.16, 0.16));
    let mut mesh = Mesh::default();
    for (t, w) in [(0.0, 1.0), (0.55, 0.8), (1.0, 0.0)] {
        let spine = foot + turn * dvec3(0.0, tall * (t - 0.22 * lean * t * t), lean * t * t);
        let normal = turn * dvec3(0.0, 0.35 + lean * t, -1.0).normalize();
        for side in if w > 0.0 { vec![-1.0, 1.0] } else { vec![0.0] } {
            mesh.positions.push(spine + turn * (DVec3::X * side * w * wide));
            mesh.normals.push(normal);
        }
    }
    mesh.triangles = vec![[0, 2, 1], [1, 2, 3], [2, 4, 3]];
    mesh
}

fn flower() -> (Mesh, Mesh) {
    let stem = tube(&[DVec3::ZERO, dvec3(0.02, 0.5, 0.03), dvec3(0.0, 1.0, 0.1)], 4, false, |t| 0.018 - 0.008 * t);
    let mut petals = Mesh::default();
    for i in 0..6 {
        let turn = DQuat::from_rotation_x(0.45) * DQuat::from_rotation_y(TAU * f64::from(i) / 6.0);
        let corners = [(0.0, 0.0, 0.0), (0.09, 0.05, 0.15), (0.0, 0.05, 0.27), (-0.09, 0.05, 0.15)];
        let normal = turn * dvec3(0.0, 1.0, -0.25).normalize();
        let petal = Mesh {
            positions: corners.map(|(x, y, z)| dvec3(0.0, 1.0, 0.1) + turn * dvec3(x, y, z)).into(),
            normals: vec![normal; 4],
            triangles: vec![[0, 2, 1], [0, 3, 2]],
            ..Mesh::default()
        };
        petals = petals.and(&petal);
    }
    (stem, petals)
}

pub fn scene() -> Glb {
    let mut glb = Glb::default();
    let mut random = Random(2024);
    let earth = glb.material(&Material::dielectric("earth", [0.085, 0.080, 0.035], 0.9));
    let leaf = |name, color| Material { double_sided: true, ..Material::dielectric(name, color, 0.55) };
    let grass = [[0.13, 0.19, 0.035], [0.20, 0.22, 0.05], [0.30, 0.26, 0.09]].map(|c| glb.material(&leaf("grass", c)));
    let petal = [[0.75, 0.12, 0.06], [0.85, 0.78, 0.66]].map(|c| glb.material(&leaf("petals", c)));
    let rock = glb.material(&Material::dielectric("rock", [0.33, 0.31, 0.28], 0.7));

    glb.object("ground", &ground(), earth);
    let tufts: Vec<usize> = grass
        .iter()
        .map(|&material| {
            let tuft = (0..26).fold(Mesh::default(), |all, _| all.and(&blade(&mut random)));
            let geometry = glb.geometry(&tuft);
            glb.mesh("tuft", &[(&geometry, material)])
        })
        .collect();
    let (stem, petals) = flower();
    let (stem, petals) = (glb.geometry(&stem), glb.geometry(&petals));
    let flowers = petal.map(|colour| glb.mesh("flower", &[(&stem, grass[0]), (&petals, colour)]));
    let stones: Vec<usize> = (0..3)
        .map(|_| {
            let geometry = glb.geometry(&stone(2, &mut random));
            glb.mesh("stone", &[(&geometry, rock)])
        })
        .collect();

    // Nearer to the camera things stand closer: distance grows with the square of a uniform number.
    let spot = |random: &mut Random| {
        let t = random.unit();
        let z = 3.2 - 46.0 * (0.35 * t + 0.65 * t * t);
        let x = random.between(-0.5, 0.5) * (6.0 + 0.75 * (3.2 - z)).min(WIDTH);
        (x, z)
    };
    let place = |random: &mut Random, x: f64, z: f64, size: f64, sink: f64, lean: f64| Placement {
        translation: dvec3(x, height(x, z) - sink, z),
        rotation: DQuat::from_rotation_arc(DVec3::Y, DVec3::Y.lerp(upright(x, z), lean).normalize())
            * DQuat::from_rotation_y(random.between(0.0, TAU)),
        scale: size,
    };
    let patches = |x: f64, z: f64, seed| fractal((x + 64.0) / 128.0, (z + 64.0) / 128.0, (24, 24), 2, seed);
    for _ in 0..3400 {
        let (x, z) = spot(&mut random);
        let dry = patches(x, z, 5) + random.between(-0.18, 0.18);
        let kind = usize::from(dry >= 0.45) + usize::from(dry >= 0.6);
        let size = random.between(0.34, 0.62);
        glb.instance(tufts[kind], &place(&mut random, x, z, size, 0.01, 0.5));
    }
    let mut planted = 0;
    while planted < 620 {
        let (x, z) = spot(&mut random);
        if patches(x, z, 77) > random.between(0.42, 0.75) {
            let kind = usize::from(patches(x, z, 31) + random.between(-0.1, 0.1) > 0.52);
            let size = random.between(0.4, 0.66);
            glb.instance(flowers[kind], &place(&mut random, x, z, size, 0.0, 0.3));
            planted += 1;
        }
    }
    for i in 0..260 {
        let (x, z) = spot(&mut random);
        let size = 0.06 + 0.5 * random.unit().powi(5);
        glb.instance(stones[i % 3], &place(&mut random, x, z, size, 0.15 * size, 1.0));
    }
    let boulders = [(-1.15, -1.6, 0.62), (1.75, -3.4, 0.85), (2.7, -2.7, 0.4), (-4.2, -9.0, 1.2)];
    for (i, (x, z, size)) in boulders.into_iter().enumerate() {
        glb.instance(stones[i % 3], &place(&mut random, x, z, size, 0.25 * size, 1.0));
    }
    // A pale moon of a ball to read the light by.
    let chalk = glb.material(&Material::lambert("chalk", [0.7; 3]));
    let ball = icosphere(4).scaled(0.42);
    glb.object("chalk ball", &ball.translated(dvec3(0.35, height(0.35, -2.6) + 0.4, -2.6)), chalk);
    let eye = dvec3(0.0, height(0.0, 5.0) + 1.15, 5.0);
    glb.camera("camera", eye, dvec3(0.0, height(0.0, -12.0) + 0.9, -12.0), 36.0, 16.0 / 9.0);
    glb
}
