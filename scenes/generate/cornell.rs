//! The Cornell box, from its published measurements (Cornell University Program of Computer Graphics), a hundredth of
//! their unit to the metre, turned so that the camera looks along −z.

use glam::{DVec3, dvec3};

use crate::glb::{Glb, Material};
use crate::mesh::{Mesh, quad};

/// From the published axes.
fn at(p: [f64; 3]) -> DVec3 {
    dvec3(2.78 - p[0] / 100.0, p[1] / 100.0, 2.796 - p[2] / 100.0)
}

fn wall(corners: [[f64; 3]; 4]) -> Mesh {
    quad(corners.map(at))
}

/// A block that stands on the floor, from the corners of its top.
fn block(top: [[f64; 3]; 4]) -> Mesh {
    let floor = |[x, _, z]: [f64; 3]| [x, 0.0, z];
    (0..4).map(|i| (top[i], top[(i + 1) % 4])).fold(wall(top), |all, (a, b)| all.and(&wall([b, a, floor(a), floor(b)])))
}

pub fn scene() -> Glb {
    let mut glb = Glb::default();
    let white = glb.material(&Material::lambert("white", [0.73, 0.73, 0.73]));
    let red = glb.material(&Material::lambert("red", [0.65, 0.05, 0.05]));
    let green = glb.material(&Material::lambert("green", [0.12, 0.45, 0.15]));
    let emitter = glb.material(&Material::emitter("lamp", [17.0, 12.0, 4.0]));
    let room = [
        ("floor", [[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]], white),
        ("ceiling", [[556.0, 548.8, 0.0], [556.0, 548.8, 559.2], [0.0, 548.8, 559.2], [0.0, 548.8, 0.0]], white),
        ("back wall", [[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]], white),
        ("right wall", [[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]], green),
        ("left wall", [[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]], red),
        ("lamp", [[343.0, 548.3, 227.0], [343.0, 548.3, 332.0], [213.0, 548.3, 332.0], [213.0, 548.3, 227.0]], emitter),
    ];
    for (name, corners, material) in room {
        glb.object(name, &wall(corners), material);
    }
    let short = [[130.0, 165.0, 65.0], [82.0, 165.0, 225.0], [240.0, 165.0, 272.0], [290.0, 165.0, 114.0]];
    let tall = [[423.0, 330.0, 247.0], [265.0, 330.0, 296.0], [314.0, 330.0, 456.0], [472.0, 330.0, 406.0]];
    glb.object("short block", &block(short), white);
    glb.object("tall block", &block(tall), white);
    glb.camera("camera", at([278.0, 273.0, -800.0]), at([278.0, 273.0, 0.0]), 39.3, 1.0);
    glb
}
