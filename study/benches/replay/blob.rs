//! The scene: a bumpy metal ball over a diffuse ground, under a sky whose small sun carries most of the light.

use std::f64::consts::PI;

use bismar::scene::Environment;
use glam::{DVec3, dvec3};

use crate::glb::{Glb, Material};
use crate::mesh::{Mesh, quad};

/// A binary glTF file; the ball has 4 · `rings`² triangles, flat ones.
pub fn file(rings: u32) -> Vec<u8> {
    let mut glb = Glb::default();
    let gold = glb.material(&Material { double_sided: true, ..Material::metal("gold", [0.9, 0.7, 0.4], 0.387) });
    let ground = glb.material(&Material { double_sided: true, ..Material::lambert("ground", [0.6; 3]) });
    glb.object("ball", &ball(rings), gold);
    let (s, y) = (6.0, -1.2);
    let mut flat = quad([dvec3(-s, y, s), dvec3(s, y, s), dvec3(s, y, -s), dvec3(-s, y, -s)]);
    flat.normals.clear();
    glb.object("ground", &flat, ground);
    glb.camera("camera", dvec3(0.0, 1.0, 4.0), dvec3(0.0, 0.2, 0.0), 0.927_f64.to_degrees(), 1.0);
    glb.finish()
}

fn ball(rings: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let wide = 2 * rings + 1;
    for i in 0..=rings {
        for j in 0..wide {
            let (theta, phi) = (f64::from(i) / f64::from(rings) * PI, f64::from(j) / f64::from(rings) * PI);
            let bumps =
                0.15 * (9.0 * phi).sin() * (7.0 * theta).sin() + 0.03 * (53.0 * phi).sin() * (47.0 * theta).cos();
            let unit: DVec3 = dvec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
            mesh.positions.push(unit * (1.0 + bumps));
        }
    }
    for a in (0..rings).flat_map(|i| (0..2 * rings).map(move |j| i * wide + j)) {
        mesh.triangles.push([a, a + 1, a + wide]);
        mesh.triangles.push([a + 1, a + wide + 1, a + wide]);
    }
    mesh
}

/// 512 by 256 texels, nine of which are the sun.
pub fn sky() -> Environment {
    let (width, height) = (512, 256);
    let texel = |x: u32, y: u32| {
        let up = 1.0 - y as f32 / (height - 1) as f32;
        let sun = (60..63).contains(&y) && (100..103).contains(&x);
        if sun { [3000.0; 3] } else { [0.3 + 0.2 * up, 0.5 + 0.2 * up, 0.9] }
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| texel(x, y))).collect();
    Environment { name: "sky".into(), width, height, pixels, rotation: 0.0, strength: 1.0 }
}
