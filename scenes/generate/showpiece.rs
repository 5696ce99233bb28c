//! A still life: a bismar, the old steelyard whose fulcrum slides along the beam, weighs a burning candle against its
//! own heavy end. Light on one side, a scattering surface on the other.
//!
//! Metres; the table's top is y = 0, the camera looks along −z, a window is on the left.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3, dvec2, dvec3};
use image::ImageError;

use crate::glb::{Glb, Material, Placement};
use crate::mesh::{
    Mesh, cuboid, lathe, panel, profile_spline, quad, rounded_box, smoothed, sphere, spline, textured_rectangle, torus,
    tube,
};
use crate::pictures::{jpeg, plaster, png, wood};

/// Where the beam rests in its loop.
const FULCRUM: DVec3 = dvec3(-0.055, 0.302, 0.0);
/// The candle's side rides a little high.
const TILT: f64 = 0.028;
/// From the fulcrum to the neck that carries the load, along the beam.
const LOAD_ARM: f64 = 0.287;

pub fn scene() -> Result<Glb, ImageError> {
    let mut glb = Glb::default();
    room(&mut glb)?;
    let brass = glb.material(&Material::metal("brass", [0.85, 0.63, 0.31], 0.19));
    let iron = glb.material(&Material::metal("blackened iron", [0.17, 0.165, 0.16], 0.36));
    bismar(&mut glb, brass, iron);
    load(&mut glb, brass, iron);
    stand(&mut glb, iron);
    weights_on_a_book(&mut glb, brass);
    balls(&mut glb);
    jug(&mut glb);
    lemons_and_coins(&mut glb);
    glb.camera("camera", dvec3(0.03, 0.315, 1.34), dvec3(0.012, 0.198, 0.0), 22.5, 16.0 / 9.0);
    Ok(glb)
}

/// Table, walls and window.
fn room(glb: &mut Glb) -> Result<(), ImageError> {
    let color = glb.texture("wood colour", &jpeg(&wood::color(1024, 512), 88)?, "image/jpeg");
    let roughness = glb.texture("wood roughness", &jpeg(&wood::roughness(512, 256), 85)?, "image/jpeg");
    let normal = glb.texture("wood normal", &png(&wood::normal(512, 256))?, "image/png");
    let table = glb.material(&Material {
        color_texture: Some(color),
        metallic_roughness_texture: Some(roughness),
        normal_texture: Some((normal, 1.0)),
        ..Material::dielectric("walnut", [1.0; 3], 1.0)
    });
    let (left, right, back, front) = (-0.95, 0.95, -0.5, 0.5);
    let corner = dvec3(left, 0.0, front);
    let (x, z) = (DVec3::X * (right - left), DVec3::Z * (back - front));
    glb.object(
        "table top",
        &textured_rectangle(corner, x, z, dvec2((right - left) / 0.9, (front - back) / 0.45)),
        table,
    );

    let color = glb.texture("plaster colour", &jpeg(&plaster::color(256), 85)?, "image/jpeg");
    let normal = glb.texture("plaster normal", &png(&plaster::normal(128))?, "image/png");
    let wall = glb.material(&Material {
        color_texture: Some(color),
        normal_texture: Some((normal, 1.0)),
        ..Material::dielectric("plaster", [1.0; 3], 0.9)
    });
    let (x0, x1, y0, y1, z0, z1) = (-1.5, 1.7, -0.75, 1.75, -0.62, 2.3);
    let corner = dvec3(x0, y0, z0);
    let extent = dvec2(x1 - x0, y1 - y0);
    glb.object("back wall", &textured_rectangle(corner, DVec3::X * extent.x, DVec3::Y * extent.y, extent / 0.8), wall);
    let plain = glb.material(&Material::lambert("room", [0.30, 0.275, 0.24]));
    let p = |i: usize| dvec3([x0, x1][i & 1], [y0, y1][i >> 1 & 1], [z0, z1][i >> 2]);
    // Left, right, ceiling, floor, and the wall behind the camera, all facing inwards.
    for face in [[4, 0, 2, 6], [1, 5, 7, 3], [2, 3, 7, 6], [4, 5, 1, 0], [5, 4, 6, 7]] {
        glb.object("room", &quad(face.map(p)), plain);
    }

    let daylight = glb.material(&Material::emitter("daylight", [15.0, 17.0, 20.0]));
    let (wide, tall, bar) = (0.30, 0.36, 0.045);
    for i in 0..6 {
        let centre = dvec3(x0 + 0.01, 0.42 + (tall + bar) * f64::from(i / 2), -0.02 + (wide + bar) * f64::from(i % 2));
        glb.object("window pane", &panel(centre, centre + DVec3::X, wide, tall), daylight);
    }
    let ember = glb.material(&Material::emitter("hearth", [5.0, 2.6, 1.1]));
    glb.object("hearth", &panel(dvec3(1.45, 0.55, 1.3), dvec3(0.1, 0.15, 0.0), 0.5, 0.5), ember);
    Ok(())
}

/// From the beam's own axis (+y, fulcrum at 0) to where it hangs.
fn along_beam(mesh: Mesh) -> Mesh {
    mesh.rotated(DQuat::from_rotation_z(TILT - PI / 2.0)).translated(FULCRUM)
}

fn on_beam(distance: f64) -> DVec3 {
    FULCRUM + DQuat::from_rotation_z(TILT) * (DVec3::X * distance)
}

fn bismar(glb: &mut Glb, brass: usize, iron: usize) {
    let mut profile = profile_spline(&[(0.0, -0.226), (0.007, -0.222), (0.0085, -0.216), (0.0045, -0.208)], 5);
    profile.extend(profile_spline(
        &[(0.011, -0.205), (0.034, -0.190), (0.0495, -0.160), (0.046, -0.130), (0.030, -0.105), (0.0165, -0.090)],
        8,
    ));
    // Beads between the weight and the beam.
    for (start, radius) in [(-0.0895, 0.0195), (-0.0795, 0.0150)] {
        profile.extend((0..=8).map(|i| f64::from(i) / 8.0).map(|t| {
            let bulge = (PI * t).sin();
            (radius - 0.0055 + 0.0055 * bulge, start + 0.009 * t)
        }));
    }
    let beam = |s: f64| 0.0098 - 0.0085 * (s + 0.07).max(0.0);
    glb.object("weight end", &along_beam(lathe(&profile, 64, 32.0)), brass);
    let mut profile = vec![(beam(-0.072), -0.072)];
    // The scale: a groove every centimetre and a half.
    for i in 0..17 {
        let s = 0.03 + 0.015 * f64::from(i);
        let deep = if i % 4 == 0 { 0.0018 } else { 0.0011 };
        profile.extend([(beam(s), s - 0.0011), (beam(s) - deep, s), (beam(s), s + 0.0011)]);
    }
    profile.extend([(0.0092, 0.281), (0.0092, 0.2835), (0.0052, 0.285), (0.0052, 0.289), (0.0096, 0.2905)]);
    profile.extend(profile_spline(&[(0.0096, 0.2925), (0.0105, 0.298), (0.006, 0.304), (0.0, 0.3065)], 5));
    glb.object("beam", &along_beam(lathe(&profile, 28, 32.0)), brass);

    // The loop that slides along the beam, and the shackle above it.
    let turn = DQuat::from_rotation_z(PI / 2.0);
    let ring = torus(0.0185, 0.0026, 40, 12).rotated(turn).translated(FULCRUM + DVec3::Y * 0.0075);
    glb.object("fulcrum loop", &ring, iron);
    let link = torus(0.0145, 0.0022, 36, 12).rotated(DQuat::from_rotation_x(PI / 2.0));
    glb.object("shackle", &link.translated(FULCRUM + DVec3::Y * 0.0365), iron);
}

/// Hook, cords, pan and candle.
fn load(glb: &mut Glb, brass: usize, iron: usize) {
    let neck = on_beam(LOAD_ARM);
    let ring = torus(0.0125, 0.0018, 32, 10).rotated(DQuat::from_rotation_z(PI / 2.0 + 0.12));
    glb.object("load ring", &ring.translated(neck - DVec3::Y * 0.007), iron);
    let top = neck - DVec3::Y * 0.0195;
    let hook = [
        (0.007, -0.008),
        (0.0075, 0.000),
        (0.003, 0.0055),
        (-0.003, 0.0025),
        (-0.001, -0.010),
        (0.001, -0.022),
        (0.0075, -0.030),
        (0.0055, -0.0395),
        (-0.003, -0.041),
        (-0.0085, -0.034),
    ];
    let path: Vec<_> = hook.map(|(x, y)| top + dvec3(x, y, 0.0)).into();
    let taper = |t: f64| 0.0017 - 0.0007 * (2.0 * t - 1.0).powi(4);
    glb.object("hook", &tube(&spline(&path, 5), 10, false, taper), iron);

    let knot = top + dvec3(0.0005, -0.0425, 0.0);
    let hemp = glb.material(&Material::dielectric("hemp", [0.30, 0.20, 0.10], 0.9));
    let centre = dvec3(knot.x, 0.088, 0.0);
    let (rim, rim_height) = (0.0745, 0.0255);
    for i in 0..3 {
        let (sin, cos) = (TAU * f64::from(i) / 3.0 + 0.5).sin_cos();
        let end = centre + dvec3((rim - 0.002) * cos, rim_height, (rim - 0.002) * sin);
        let sag = DVec3::Y * 0.0015;
        let path = spline(&[knot, knot.lerp(end, 0.5) - sag, end, end - dvec3(0.0, 0.006, 0.0)], 6);
        glb.object("cord", &tube(&path, 7, false, |_| 0.0011), hemp);
        glb.object("knot", &sphere(0.0024, 8).translated(end + DVec3::Y * 0.001), hemp);
    }
    glb.object("knot", &sphere(0.0034, 10).translated(knot), hemp);

    let outside = profile_spline(&[(0.0, 0.0), (0.03, 0.0012), (0.056, 0.0095), (rim, rim_height)], 6);
    let lip =
        [(rim + 0.0018, rim_height + 0.0004), (rim + 0.0018, rim_height + 0.0022), (rim - 0.0006, rim_height + 0.0022)];
    let inside = profile_spline(&[(rim - 0.0018, rim_height), (0.055, 0.0115), (0.03, 0.0034), (0.0, 0.0022)], 6);
    let pan = lathe(&[outside, lip.to_vec(), inside].concat(), 64, 30.0);
    glb.object("pan", &pan.translated(centre), brass);

    let wax = glb.material(&Material {
        emission: [0.34, 0.17, 0.06],
        ..Material::dielectric("beeswax", [0.78, 0.60, 0.32], 0.4)
    });
    let candle = profile_spline(
        &[
            (0.0195, 0.0026),
            (0.0185, 0.02),
            (0.0180, 0.042),
            (0.0165, 0.0455),
            (0.013, 0.0445),
            (0.0075, 0.0405),
            (0.0, 0.0395),
        ],
        4,
    );
    glb.object("candle", &lathe(&candle, 36, 60.0).translated(centre), wax);
    let soot = glb.material(&Material::dielectric("wick", [0.02, 0.017, 0.015], 0.9));
    let wick = [centre + DVec3::Y * 0.039, centre + dvec3(0.0003, 0.047, 0.0), centre + dvec3(0.002, 0.053, 0.0)];
    glb.object("wick", &tube(&wick, 6, false, |_| 0.0007), soot);
    let flame = glb.material(&Material::emitter("flame", [215.0, 104.0, 30.0]));
    let shape = profile_spline(
        &[
            (0.0, 0.0),
            (0.0032, 0.002),
            (0.0052, 0.008),
            (0.0046, 0.015),
            (0.0026, 0.023),
            (0.0009, 0.030),
            (0.0, 0.034),
        ],
        3,
    );
    glb.object("flame", &lathe(&shape, 16, 180.0).translated(centre + dvec3(0.001, 0.0475, 0.0)), flame);
}

fn stand(glb: &mut Glb, iron: usize) {
    let (foot, bend) = (FULCRUM.with_y(0.0).with_z(-0.17), 0.085);
    let tip = FULCRUM.y + 0.048;
    let mut path = vec![foot + DVec3::Y * 0.012, foot + DVec3::Y * 0.2, foot + DVec3::Y * (tip + 0.01)];
    path.extend(
        (0..=20)
            .map(|i| PI * f64::from(i) / 20.0)
            .map(|a| foot + dvec3(0.0, tip + 0.012 + bend * a.sin(), bend * (1.0 - a.cos()))),
    );
    path.push(dvec3(FULCRUM.x, tip - 0.002, 0.0));
    // A small crook at the end carries the shackle.
    path.extend(
        (1..=8)
            .map(|i| 1.35 * PI * f64::from(i) / 8.0)
            .map(|a| dvec3(FULCRUM.x, tip - 0.002 - 0.006 * a.sin(), -0.006 * (1.0 - a.cos()))),
    );
    glb.object("post", &tube(&path, 16, false, |t| 0.0066 - 0.0042 * t * t), iron);
    let base = profile_spline(
        &[
            (0.078, 0.0),
            (0.080, 0.005),
            (0.070, 0.0095),
            (0.045, 0.013),
            (0.022, 0.021),
            (0.0135, 0.036),
            (0.0095, 0.06),
        ],
        6,
    );
    let base = [base, vec![(0.0135, 0.061), (0.0135, 0.066), (0.006, 0.069)]].concat();
    glb.object("foot", &lathe(&base, 56, 40.0).translated(foot), iron);
}

fn weights_on_a_book(glb: &mut Glb, brass: usize) {
    let place = |mesh: Mesh| mesh.rotated(DQuat::from_rotation_y(0.24)).translated(dvec3(-0.285, 0.0, 0.0));
    let leather = glb.material(&Material::dielectric("oxblood leather", [0.135, 0.020, 0.016], 0.38));
    let paper = glb.material(&Material::dielectric("paper", [0.66, 0.57, 0.42], 0.9));
    let (wide, thick, deep) = (0.205, 0.036, 0.145);
    let board = |y: f64| rounded_box(dvec3(wide, 0.0042, deep), 0.0015, 2).translated(dvec3(0.0, y, 0.0));
    glb.object("cover", &place(board(0.0021)), leather);
    glb.object("cover", &place(board(thick - 0.0021)), leather);
    let spine = rounded_box(dvec3(0.012, thick, deep), 0.0055, 4);
    glb.object("spine", &place(spine.translated(dvec3(-wide / 2.0, thick / 2.0, 0.0))), leather);
    for z in [-0.045, 0.0, 0.045] {
        let band = rounded_box(dvec3(0.0085, thick + 0.001, 0.006), 0.0028, 3);
        glb.object("band", &place(band.translated(dvec3(-wide / 2.0 - 0.0028, thick / 2.0, z))), leather);
    }
    let pages = cuboid(dvec3(wide - 0.010, thick - 0.0084, deep - 0.009)).translated(dvec3(-0.002, thick / 2.0, 0.0));
    glb.object("pages", &place(pages), paper);

    // Turned weights of falling size: radius and height in ratio, a knob on top.
    let shape = |r: f64| {
        let mut profile = vec![(0.0, 0.0), (0.93 * r, 0.0), (r, 0.08 * r), (r, 0.42 * r), (0.955 * r, 0.45 * r)];
        profile.extend([(0.955 * r, 0.52 * r), (r, 0.55 * r), (r, 1.48 * r), (0.92 * r, 1.56 * r)]);
        profile.extend(profile_spline(
            &[
                (0.42 * r, 1.60 * r),
                (0.22 * r, 1.70 * r),
                (0.21 * r, 1.80 * r),
                (0.40 * r, 2.0 * r),
                (0.33 * r, 2.22 * r),
                (0.0, 2.3 * r),
            ],
            5,
        ));
        lathe(&profile, 48, 32.0)
    };
    for (r, x, z) in [(0.0265, -0.048, -0.018), (0.0205, 0.012, 0.012), (0.0155, 0.052, -0.012), (0.0115, 0.072, 0.030)]
    {
        glb.object("weight", &place(shape(r).translated(dvec3(x, thick, z))), brass);
    }
}

fn balls(glb: &mut Glb) {
    let kinds = [
        (Material::metal("steel", [0.66, 0.65, 0.63], 0.045), 0.044, 0.030, 0.035),
        (Material::metal("copper", [0.93, 0.55, 0.42], 0.32), 0.030, 0.108, -0.045),
        (Material::dielectric("red lacquer", [0.40, 0.016, 0.010], 0.09), 0.031, 0.098, 0.085),
        (Material::dielectric("cobalt glaze", [0.012, 0.045, 0.26], 0.05), 0.0235, -0.046, 0.098),
        (Material::dielectric("ivory", [0.72, 0.64, 0.50], 0.3), 0.0175, 0.036, 0.128),
        (Material::metal("gold", [1.0, 0.74, 0.34], 0.12), 0.0135, -0.004, 0.142),
    ];
    let ball = glb.geometry(&sphere(1.0, 48));
    for (material, radius, x, z) in kinds {
        let name = material.name;
        let material = glb.material(&material);
        glb.shared(name, &ball, material, &Placement::scaled(dvec3(x, radius, z), radius));
    }
}

fn jug(glb: &mut Glb) {
    let glaze = glb.material(&Material::dielectric("celadon glaze", [0.045, 0.155, 0.135], 0.07));
    let foot = dvec3(0.385, 0.0, -0.15);
    let outside = profile_spline(
        &[
            (0.046, 0.0),
            (0.050, 0.006),
            (0.070, 0.045),
            (0.082, 0.090),
            (0.072, 0.135),
            (0.046, 0.172),
            (0.034, 0.198),
            (0.036, 0.222),
            (0.047, 0.244),
        ],
        6,
    );
    let inside = profile_spline(&[(0.0435, 0.2455), (0.033, 0.222), (0.031, 0.198), (0.040, 0.170), (0.0, 0.12)], 6);
    let body = [outside, vec![(0.0468, 0.2462), (0.0452, 0.247)], inside].concat();
    glb.object("jug", &lathe(&body, 72, 60.0).translated(foot), glaze);
    let handle = [(0.040, 0.228), (0.066, 0.232), (0.098, 0.205), (0.106, 0.165), (0.094, 0.128), (0.072, 0.108)];
    let path: Vec<_> = handle.map(|(x, y)| foot + DQuat::from_rotation_y(0.45) * dvec3(x, y, 0.0)).into();
    glb.object("handle", &tube(&spline(&path, 7), 16, false, |t| 0.0085 - 0.0025 * (PI * t).sin()), glaze);
}

fn lemons_and_coins(glb: &mut Glb) {
    let peel = glb.material(&Material::dielectric("lemon", [0.80, 0.52, 0.035], 0.36));
    let outline = profile_spline(
        &[
            (0.0, -0.043),
            (0.0055, -0.0415),
            (0.009, -0.036),
            (0.021, -0.027),
            (0.0285, -0.012),
            (0.0295, 0.004),
            (0.024, 0.021),
            (0.0125, 0.033),
            (0.006, 0.0375),
            (0.0, 0.039),
        ],
        4,
    );
    let mut lemon = lathe(&outline, 48, 180.0);
    // A little out of round.
    for p in &mut lemon.positions {
        let around = p.z.atan2(p.x);
        let lump = 1.0 + 0.018 * (3.0 * around + 90.0 * p.y).sin() + 0.010 * (5.0 * around - 150.0 * p.y).sin();
        *p *= dvec3(lump, 1.0, lump);
    }
    let lemon = glb.geometry(&smoothed(lemon));
    let lemon = glb.mesh("lemon", &[(&lemon, peel)]);
    for (x, z, y, turn, size) in [(0.325, 0.055, 0.0288, 0.5, 1.0), (0.405, 0.005, 0.0268, -0.75, 0.93)] {
        let rotation = DQuat::from_rotation_y(turn) * DQuat::from_rotation_z(PI / 2.0 + 0.06);
        glb.instance(lemon, &Placement { translation: dvec3(x, y, z), rotation, scale: size });
    }

    let silver = glb.material(&Material::metal("silver", [0.91, 0.88, 0.81], 0.24));
    let (r, thick) = (0.0135, 0.0018);
    let coin = [(0.0, 0.0), (r, 0.0), (r, thick), (0.9 * r, thick), (0.88 * r, thick - 0.0003), (0.0, thick - 0.0002)];
    let coin = glb.geometry(&lathe(&coin, 40, 20.0));
    let coin = glb.mesh("coin", &[(&coin, silver)]);
    let stack = (0..5).map(|i| {
        let wobble = |k: f64| 0.0016 * (k * f64::from(i)).sin();
        Placement::at(dvec3(0.205 + wobble(2.1), thick * f64::from(i), 0.118 + wobble(3.7)))
    });
    let leaning =
        Placement { translation: dvec3(0.2305, 0.0, 0.1235), rotation: DQuat::from_rotation_z(0.52), scale: 1.0 };
    let loose = [(0.172, 0.146), (0.245, 0.150)].map(|(x, z)| Placement::at(dvec3(x, 0.0, z)));
    for place in stack.chain([leaning]).chain(loose) {
        glb.instance(coin, &place);
    }
}
