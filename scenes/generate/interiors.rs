//! Rooms whose light comes by few ways: what guiding is for. The walls are thick and closed all around.

use glam::{DVec3, dvec3};

use crate::glb::{Glb, Material};
use crate::mesh::{Mesh, cuboid, inside_out, lathe, profile_spline, rounded_box, sphere};
use crate::pictures::Sky;

/// A box between two corners.
fn between(low: DVec3, high: DVec3) -> Mesh {
    cuboid(high - low).translated((low + high) / 2.0)
}

/// A room of this size on the floor about the origin, without its right wall: floor, ceiling, left, back and front wall.
fn shell(glb: &mut Glb, [w, h, d]: [f64; 3], [ground, wall]: [usize; 2]) {
    const THICK: f64 = 0.2;
    let (x, z) = (w / 2.0, d / 2.0);
    let (low, high) = (dvec3(-x - THICK, -THICK, -z - THICK), dvec3(x + THICK, h + THICK, z + THICK));
    glb.object("floor", &between(low, dvec3(high.x, 0.0, high.z)), ground);
    glb.object("ceiling", &between(dvec3(low.x, h, low.z), high), wall);
    glb.object("left wall", &between(dvec3(low.x, 0.0, low.z), dvec3(-x, h, high.z)), wall);
    glb.object("back wall", &between(dvec3(-x, 0.0, low.z), dvec3(high.x, h, -z)), wall);
    glb.object("front wall", &between(dvec3(-x, 0.0, z), dvec3(high.x, h, high.z)), wall);
}

/// The sky through a slit in the right wall, beside things of many finishes.
pub fn slit() -> Glb {
    let mut glb = Glb::default();
    let plaster = glb.material(&Material::lambert("plaster", [0.72, 0.70, 0.66]));
    let boards = glb.material(&Material::dielectric("boards", [0.34, 0.22, 0.13], 0.4));
    let clay = glb.material(&Material::lambert("clay", [0.55, 0.27, 0.16]));
    let tin = glb.material(&Material::metal("tin", [0.78, 0.77, 0.75], 0.35));
    let (w, h, d) = (4.6, 2.7, 5.2);
    shell(&mut glb, [w, h, d], [boards, plaster]);
    let x = w / 2.0;
    let wall = |y: [f64; 2], z: [f64; 2]| between(dvec3(x, y[0], z[0]), dvec3(x + 0.2, y[1], z[1]));
    for (y, z) in [
        ([0.0, h], [-d / 2.0, -1.05]),
        ([0.0, h], [-0.93, d / 2.0]),
        ([0.0, 0.5], [-1.05, -0.93]),
        ([2.3, h], [-1.05, -0.93]),
    ] {
        glb.object("right wall", &wall(y, z), plaster);
    }
    glb.object("bench", &between(dvec3(-2.0, 0.0, -2.4), dvec3(0.2, 0.45, -1.7)), boards);
    glb.object("ball", &sphere(0.32, 32).translated(dvec3(-0.4, 0.32, -0.6)), clay);
    glb.object("tin", &sphere(0.22, 32).translated(dvec3(-1.3, 0.67, -2.05)), tin);
    glb.object("block", &rounded_box(dvec3(0.7, 1.1, 0.7), 0.05, 3).translated(dvec3(1.2, 0.55, -1.9)), plaster);
    glb.camera("camera", dvec3(-0.2, 1.4, 2.4), dvec3(0.0, 0.95, -1.4), 54.0, 1.5);
    glb
}

pub const SLIT_SKY: Sky = Sky {
    sun: dvec3(-0.4, 0.6, 0.3),
    sun_radius: 2.0,
    sun_radiance: dvec3(2700.0, 2340.0, 1800.0),
    zenith: dvec3(150.0, 240.0, 420.0),
    horizon: dvec3(660.0, 690.0, 720.0),
    ground: dvec3(180.0, 162.0, 126.0),
    glow: dvec3(240.0, 210.0, 150.0),
};

/// An area light in the next room, whose door stands ajar.
pub fn ajar() -> Glb {
    let mut glb = Glb::default();
    let plaster = glb.material(&Material::lambert("plaster", [0.74, 0.72, 0.69]));
    let tiles = glb.material(&Material::dielectric("tiles", [0.42, 0.39, 0.35], 0.35));
    let oak = glb.material(&Material::dielectric("oak", [0.36, 0.24, 0.14], 0.45));
    let green = glb.material(&Material::lambert("green", [0.20, 0.42, 0.24]));
    let steel = glb.material(&Material::metal("steel", [0.62, 0.62, 0.64], 0.4));
    let emitter = glb.material(&Material::emitter("lamp", [2700.0, 2280.0, 1680.0]));
    let (w, h, d) = (8.0, 2.7, 4.6);
    shell(&mut glb, [w, h, d], [tiles, plaster]);
    let x = w / 2.0;
    glb.object("right wall", &between(dvec3(x, 0.0, -d / 2.0), dvec3(x + 0.2, h, d / 2.0)), plaster);
    // Between the rooms, about a doorway.
    let (near, far, lintel) = (0.5, -0.4, 2.05);
    for (low, high) in [
        (dvec3(0.9, 0.0, -d / 2.0), dvec3(1.05, h, far)),
        (dvec3(0.9, 0.0, near), dvec3(1.05, h, d / 2.0)),
        (dvec3(0.9, lintel, far), dvec3(1.05, h, near)),
    ] {
        glb.object("partition", &between(low, high), plaster);
    }
    let turn = glam::DQuat::from_rotation_y(0.42);
    let leaf = cuboid(dvec3(0.04, lintel - 0.02, near - far - 0.02)).translated(dvec3(0.0, 0.0, (far - near) / 2.0));
    glb.object("door", &leaf.rotated(turn).translated(dvec3(0.97, lintel / 2.0, near)), oak);
    glb.object("lamp", &between(dvec3(3.2, h - 0.06, -1.0), dvec3(3.7, h - 0.02, -0.5)), emitter);
    glb.object("table", &between(dvec3(-2.2, 0.66, -1.8), dvec3(-0.6, 0.72, -0.9)), oak);
    for (x, z) in [(-2.15, -1.75), (-0.7, -1.75), (-0.7, -1.0), (-2.15, -1.0)] {
        glb.object("leg", &between(dvec3(x, 0.0, z), dvec3(x + 0.06, 0.66, z + 0.06)), oak);
    }
    let pot = profile_spline(&[(0.0, 0.0), (0.14, 0.0), (0.2, 0.12), (0.12, 0.26), (0.14, 0.3)], 6);
    glb.object("pot", &lathe(&pot, 40, 50.0).translated(dvec3(-1.7, 0.72, -1.35)), steel);
    glb.object("apple", &sphere(0.16, 28).translated(dvec3(-1.05, 0.88, -1.3)), green);
    glb.object("chest", &rounded_box(dvec3(0.7, 0.6, 0.5), 0.04, 3).translated(dvec3(0.2, 0.3, -1.9)), green);
    glb.camera("camera", dvec3(-2.6, 1.5, 2.1), dvec3(-0.7, 0.95, -1.2), 58.0, 1.5);
    glb
}

/// An area light in a globe of frosted glass and another in a deep shade of metal.
pub fn shade() -> Glb {
    let mut glb = Glb::default();
    let paper = glb.material(&Material::lambert("paper", [0.70, 0.66, 0.58]));
    let boards = glb.material(&Material::dielectric("boards", [0.30, 0.20, 0.12], 0.4));
    let cloth = glb.material(&Material::lambert("cloth", [0.45, 0.16, 0.14]));
    let brass = glb.material(&Material::metal("brass", [0.85, 0.66, 0.36], 0.3));
    let frosted = Material { transmission: 1.0, double_sided: true, ..Material::dielectric("frosted", [0.95; 3], 0.6) };
    let frosted = glb.material(&frosted);
    let bulb = glb.material(&Material::emitter("bulb", [420.0, 330.0, 210.0]));
    let (w, h, d) = (4.4, 2.6, 4.8);
    shell(&mut glb, [w, h, d], [boards, paper]);
    glb.object("right wall", &between(dvec3(w / 2.0, 0.0, -d / 2.0), dvec3(w / 2.0 + 0.2, h, d / 2.0)), paper);
    let globe = dvec3(-1.2, 1.05, -1.5);
    glb.object("globe", &sphere(0.2, 32).translated(globe), frosted);
    glb.object("bulb", &sphere(0.045, 12).translated(globe), bulb);
    glb.object("stand", &between(globe - dvec3(0.05, 1.05, 0.05), globe - dvec3(-0.05, 0.22, -0.05)), brass);
    // Open below: its light falls on the table alone.
    let hood = [(0.06, 0.34), (0.10, 0.2), (0.2, 0.0)];
    let outside = lathe(&profile_spline(&hood, 6), 40, 60.0);
    let hung = dvec3(0.6, 1.45, -1.0);
    glb.object("hood", &outside.clone().and(&inside_out(&outside)).translated(hung), brass);
    glb.object("bulb", &sphere(0.045, 12).translated(hung + DVec3::Y * 0.2), bulb);
    glb.object("table", &between(dvec3(0.1, 0.68, -1.4), dvec3(1.3, 0.74, -0.5)), boards);
    glb.object("foot", &between(dvec3(0.6, 0.0, -1.05), dvec3(0.8, 0.68, -0.85)), boards);
    glb.object("sofa", &rounded_box(dvec3(1.6, 0.45, 0.8), 0.08, 3).translated(dvec3(-0.5, 0.22, -1.9)), cloth);
    glb.camera("camera", dvec3(0.2, 1.4, 2.2), dvec3(-0.1, 0.95, -1.2), 56.0, 1.5);
    glb
}
