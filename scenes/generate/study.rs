//! Small scenes for studies of the balance, each hard in its own way. With `cornell`, `glossy-sun`, `veach` and
//! `many-lights` they make up what `docs/balance.md` measures.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3, dvec2, dvec3};
use image::ImageError;

use crate::glb::{Glb, Material, Placement};
use crate::mesh::{
    Mesh, cuboid, floor, inside_out, lathe, panel, profile_spline, quad, rounded_box, sphere, textured_rectangle, tube,
};
use crate::pictures::{self, Sky};
use crate::random::{Random, fractal};

/// The inside of a box on the floor: floor, ceiling, left, right and back wall, open towards +z.
fn room(width: f64, height: f64, depth: f64) -> [Mesh; 5] {
    let (x, y, z) = (width / 2.0, height, depth / 2.0);
    [
        [[-x, 0.0, z], [x, 0.0, z], [x, 0.0, -z], [-x, 0.0, -z]],
        [[-x, y, -z], [x, y, -z], [x, y, z], [-x, y, z]],
        [[-x, 0.0, z], [-x, 0.0, -z], [-x, y, -z], [-x, y, z]],
        [[x, 0.0, -z], [x, 0.0, z], [x, y, z], [x, y, -z]],
        [[-x, 0.0, -z], [x, 0.0, -z], [x, y, -z], [-x, y, -z]],
    ]
    .map(|corners| quad(corners.map(DVec3::from_array)))
}

fn block(size: DVec3, base: DVec3, turn: f64) -> Mesh {
    cuboid(size).rotated(DQuat::from_rotation_y(turn)).translated(base + DVec3::Y * size.y / 2.0)
}

/// A room with sun and sky through one window and an area light at the far wall: three techniques.
pub fn window() -> Glb {
    let mut glb = Glb::default();
    let white = glb.material(&Material::lambert("plaster", [0.74, 0.72, 0.68]));
    let oak = glb.material(&Material::dielectric("oak", [0.32, 0.20, 0.11], 0.35));
    let cloth = glb.material(&Material::lambert("cloth", [0.16, 0.24, 0.36]));
    let vase = glb.material(&Material::dielectric("glaze", [0.62, 0.60, 0.55], 0.1));
    let emitter = glb.material(&Material::emitter("lamp", [9.0, 6.3, 3.6]));
    let (w, h, d) = (5.0, 2.8, 6.0);
    let [ground, ceiling, _, right, back] = room(w, h, d);
    glb.object("floor", &ground, oak);
    for (name, mesh) in [("ceiling", ceiling), ("right wall", right), ("back wall", back)] {
        glb.object(name, &mesh, white);
    }
    // The left wall, thick, around a window.
    let thick = 0.24;
    let x = -w / 2.0 - thick / 2.0;
    let (sill, lintel, near, far) = (0.85, 2.25, 0.9, -0.9);
    for (y0, y1, z0, z1) in [
        (0.0, sill, -d / 2.0, d / 2.0),
        (lintel, h, -d / 2.0, d / 2.0),
        (sill, lintel, near, d / 2.0),
        (sill, lintel, -d / 2.0, far),
        (sill, lintel, -0.03, 0.03),
    ] {
        let size = dvec3(thick, y1 - y0, z1 - z0);
        glb.object("left wall", &cuboid(size).translated(dvec3(x, (y0 + y1) / 2.0, (z0 + z1) / 2.0)), white);
    }
    // Nothing gets in from behind the camera.
    let (x, z) = (w / 2.0, d / 2.0);
    let front = [dvec3(x, 0.0, z), dvec3(-x, 0.0, z), dvec3(-x, h, z), dvec3(x, h, z)];
    glb.object("front wall", &quad(front), white);
    glb.object("roof", &block(dvec3(w + 1.0, 0.1, d + 0.2), dvec3(0.0, h + 0.01, 0.0), 0.0), white);
    glb.object("table", &block(dvec3(1.3, 0.06, 0.8), dvec3(-0.2, 0.7, -0.4), 0.2), oak);
    for (sx, sz) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        glb.object("leg", &block(dvec3(0.06, 0.7, 0.06), dvec3(-0.2 + 0.5 * sx, 0.0, -0.4 + 0.28 * sz), 0.2), oak);
    }
    glb.object("sofa", &rounded_box(dvec3(1.9, 0.5, 0.8), 0.08, 3).translated(dvec3(0.9, 0.25, -2.3)), cloth);
    glb.object("sofa back", &rounded_box(dvec3(1.9, 0.5, 0.25), 0.08, 3).translated(dvec3(0.9, 0.7, -2.65)), cloth);
    let profile = profile_spline(&[(0.0, 0.0), (0.09, 0.0), (0.13, 0.12), (0.05, 0.26), (0.07, 0.32)], 6);
    glb.object("vase", &lathe(&profile, 40, 50.0).translated(dvec3(-0.3, 0.76, -0.4)), vase);
    glb.object("lamp", &sphere(0.11, 16).translated(dvec3(2.0, 1.5, -2.5)), emitter);
    glb.camera("camera", dvec3(1.3, 1.45, 2.7), dvec3(-0.55, 1.05, -1.2), 52.0, 1.5);
    glb
}

pub const WINDOW_SKY: Sky = Sky {
    sun: dvec3(-0.70, 0.55, 0.28),
    sun_radius: 1.0,
    sun_radiance: dvec3(9000.0, 7900.0, 6400.0),
    zenith: dvec3(0.9, 1.6, 3.0),
    horizon: dvec3(3.0, 3.4, 3.8),
    ground: dvec3(0.8, 0.75, 0.6),
    glow: dvec3(1.2, 1.0, 0.7),
};

/// A large picture that shines, mostly dark with a few bright patches, over glossy and diffuse things.
pub fn screen() -> Result<Glb, ImageError> {
    let mut glb = Glb::default();
    let picture = pictures::png(&pictures::paint(128, 64, |u, v| {
        let cell = |n: f64, x: f64| (x * n).floor();
        let on = fractal(cell(8.0, u) / 8.0 + 0.01, cell(4.0, v) / 4.0 + 0.01, (8, 4), 1, 5);
        let hue = fractal(cell(8.0, u) / 8.0 + 0.01, cell(4.0, v) / 4.0 + 0.01, (8, 4), 1, 77);
        let light = if on > 0.68 { 1.0 } else { 0.03 };
        [hue, 0.55, 1.0 - hue].map(|c| light * (0.25 + 0.75 * c))
    }))?;
    let picture = glb.texture("screen", &picture, "image/png");
    let emitter = Material { emission_texture: Some(picture), ..Material::emitter("screen", [14.0; 3]) };
    let emitter = glb.material(&emitter);
    let ground = glb.material(&Material::dielectric("lino", [0.26, 0.25, 0.24], 0.25));
    let chalk = glb.material(&Material::lambert("chalk", [0.7, 0.7, 0.68]));
    let steel = glb.material(&Material::metal("steel", [0.6, 0.6, 0.62], 0.3));
    let wall = textured_rectangle(dvec3(-2.0, 0.6, -2.2), DVec3::X * 4.0, DVec3::Y * 2.0, dvec2(1.0, 1.0));
    glb.object("screen", &wall, emitter);
    glb.object("floor", &floor(8.0), ground);
    glb.object("chalk ball", &sphere(0.42, 36).translated(dvec3(-1.2, 0.42, -0.4)), chalk);
    glb.object("steel ball", &sphere(0.42, 36).translated(dvec3(0.0, 0.42, -0.1)), steel);
    glb.object("block", &block(dvec3(0.6, 0.7, 0.6), dvec3(1.2, 0.0, -0.3), 0.5), chalk);
    glb.camera("camera", dvec3(0.0, 1.5, 4.2), dvec3(0.0, 0.65, -0.6), 40.0, 1.5);
    Ok(glb)
}

/// Area lights behind slats: what little gets through decides.
pub fn slats() -> Glb {
    let mut glb = Glb::default();
    let plaster = glb.material(&Material::lambert("plaster", [0.62, 0.60, 0.56]));
    let ground = glb.material(&Material::dielectric("tiles", [0.36, 0.33, 0.30], 0.3));
    let slat = glb.material(&Material::lambert("slat", [0.05, 0.05, 0.05]));
    let emitter = glb.material(&Material::emitter("lamp", [60.0, 48.0, 34.0]));
    let [below, _, left, right, back] = room(6.0, 3.2, 6.0);
    glb.object("floor", &below, ground);
    for (name, mesh) in [("left wall", left), ("right wall", right), ("back wall", back)] {
        glb.object(name, &mesh, plaster);
    }
    let rail = glb.geometry(&cuboid(dvec3(5.0, 0.02, 0.19)));
    for i in 0..17 {
        let place = dvec3(0.0, 2.5, -1.7 + 0.2 * f64::from(i));
        let place = Placement { rotation: DQuat::from_rotation_x(-0.55), ..Placement::at(place) };
        glb.shared("slat", &rail, slat, &place);
    }
    for (x, z) in [(-1.6, -1.0), (0.1, 0.4), (1.7, -0.5)] {
        glb.object("lamp", &panel(dvec3(x, 3.1, z), dvec3(x, 0.0, z + 0.01), 0.5, 0.5), emitter);
    }
    glb.object("ball", &sphere(0.5, 36).translated(dvec3(-0.9, 0.5, -0.3)), plaster);
    glb.object("block", &block(dvec3(0.8, 1.1, 0.8), dvec3(0.9, 0.0, -1.0), 0.4), ground);
    glb.camera("camera", dvec3(0.2, 1.5, 5.6), dvec3(0.0, 1.0, -0.6), 38.0, 1.5);
    glb
}

/// A large area light over things that nearly mirror it.
pub fn mirrors() -> Glb {
    let mut glb = Glb::default();
    let emitter = glb.material(&Material::emitter("lamp", [3.2, 3.0, 2.7]));
    let ground = glb.material(&Material::dielectric("stone", [0.30, 0.29, 0.27], 0.5));
    glb.object("lamp", &panel(dvec3(0.4, 3.0, -1.6), dvec3(0.0, 0.4, 0.0), 4.2, 2.4), emitter);
    glb.object("floor", &floor(8.0), ground);
    let ball = glb.geometry(&sphere(0.46, 48));
    for (i, (name, roughness)) in
        [("mirror", 0.03), ("polished", 0.09), ("satin", 0.2), ("brushed", 0.4)].into_iter().enumerate()
    {
        let metal = glb.material(&Material::metal(name, [0.86, 0.84, 0.80], roughness));
        glb.shared(name, &ball, metal, &Placement::at(dvec3(-1.65 + 1.1 * i as f64, 0.46, 0.25 * (i % 2) as f64)));
    }
    let lacquer = glb.material(&Material::dielectric("lacquer", [0.22, 0.02, 0.02], 0.08));
    glb.object("slab", &block(dvec3(4.6, 0.05, 0.9), dvec3(0.0, 0.0, 1.35), 0.0), lacquer);
    glb.camera("camera", dvec3(0.0, 1.5, 4.6), dvec3(0.0, 0.45, 0.3), 36.0, 1.5);
    glb
}

/// Night: one small far area light, dark things, most of the picture almost black.
pub fn night() -> Glb {
    let mut glb = Glb::default();
    let coal = glb.material(&Material::dielectric("coal", [0.012; 3], 0.4));
    let soot = glb.material(&Material::lambert("soot", [0.02, 0.02, 0.022]));
    let paint = glb.material(&Material::dielectric("paint", [0.03, 0.05, 0.09], 0.18));
    let emitter = glb.material(&Material::emitter("lamp", [22.0, 15.0, 8.0]));
    glb.object("ground", &floor(14.0), coal);
    glb.object("wall", &block(dvec3(0.3, 2.2, 5.0), dvec3(-0.9, 0.0, -2.0), 0.15), soot);
    glb.object("hut", &block(dvec3(1.4, 1.3, 1.2), dvec3(1.6, 0.0, -1.6), 0.5), soot);
    glb.object(
        "barrel",
        &lathe(&[(0.0, 0.9), (0.34, 0.9), (0.38, 0.45), (0.34, 0.0)], 40, 30.0).translated(dvec3(0.4, 0.0, 0.2)),
        paint,
    );
    glb.object("lamp", &sphere(0.09, 16).translated(dvec3(-2.6, 1.7, -2.4)), emitter);
    glb.object("ember", &sphere(0.05, 12).translated(dvec3(2.3, 0.05, 0.4)), emitter);
    glb.camera("camera", dvec3(0.6, 1.6, 5.4), dvec3(0.1, 0.7, -0.8), 42.0, 1.5);
    glb
}

/// Uplights: the area lights shine at a ceiling, nearly everything that is seen is lit from there.
pub fn uplights() -> Glb {
    let mut glb = Glb::default();
    let white = glb.material(&Material::lambert("white", [0.78, 0.77, 0.74]));
    let blue = glb.material(&Material::lambert("blue", [0.16, 0.26, 0.52]));
    let rust = glb.material(&Material::lambert("rust", [0.55, 0.20, 0.09]));
    let gloss = glb.material(&Material::metal("tin", [0.75, 0.74, 0.72], 0.25));
    let emitter = glb.material(&Material::emitter("lamp", [38.0, 33.0, 26.0]));
    let [below, above, left, right, back] = room(5.0, 3.0, 5.0);
    for (name, mesh, material) in [
        ("floor", below, white),
        ("ceiling", above, white),
        ("left wall", left, rust),
        ("right wall", right, blue),
        ("back wall", back, white),
    ] {
        glb.object(name, &mesh, material);
    }
    let front = [dvec3(2.5, 0.0, 2.5), dvec3(-2.5, 0.0, 2.5), dvec3(-2.5, 3.0, 2.5), dvec3(2.5, 3.0, 2.5)];
    glb.object("front wall", &quad(front), white);
    for x in [-1.7, 1.7] {
        // A bowl around the area light that lets nothing sideways.
        let bowl = profile_spline(&[(0.0, 0.0), (0.2, 0.03), (0.27, 0.18)], 6);
        let bowl = lathe(&bowl, 32, 60.0);
        let shade = bowl.clone().and(&inside_out(&bowl));
        glb.object("bowl", &shade.translated(dvec3(x, 1.9, -2.1)), gloss);
        glb.object("lamp", &panel(dvec3(x, 1.98, -2.1), dvec3(x, 3.0, -2.09), 0.2, 0.2), emitter);
    }
    glb.object("ball", &sphere(0.5, 36).translated(dvec3(-0.8, 0.5, -0.4)), gloss);
    glb.object("block", &block(dvec3(0.8, 1.2, 0.8), dvec3(0.8, 0.0, -0.8), 0.35), white);
    glb.camera("camera", dvec3(0.0, 1.5, 2.45), dvec3(0.0, 1.2, -1.0), 62.0, 1.5);
    glb
}

/// Brushed and hammered metal: normals that change from pixel to pixel, under a sky with sun.
pub fn brushed() -> Result<Glb, ImageError> {
    let mut glb = Glb::default();
    let hammered = pictures::png(&pictures::normals(256, 256, 0.035, 1.0, |u, v| fractal(u, v, (24, 24), 3, 31)))?;
    let strokes = pictures::png(&pictures::normals(256, 256, 0.012, 1.0, |u, v| fractal(u, v, (2, 100), 2, 57)))?;
    let hammered = glb.texture("hammered", &hammered, "image/png");
    let strokes = glb.texture("strokes", &strokes, "image/png");
    let steel = Material { normal_texture: Some((strokes, 1.0)), ..Material::metal("steel", [0.58, 0.57, 0.56], 0.28) };
    let brass = Material { normal_texture: Some((hammered, 1.0)), ..Material::metal("brass", [0.85, 0.65, 0.33], 0.2) };
    let (steel, brass) = (glb.material(&steel), glb.material(&brass));
    let chalk = glb.material(&Material::lambert("chalk", [0.5, 0.5, 0.5]));
    let rectangle = |corner, x, y| textured_rectangle(corner, x, y, dvec2(2.0, 2.0));
    glb.object("plate", &rectangle(dvec3(-2.4, 0.0, 1.6), DVec3::X * 4.8, DVec3::Z * -3.2), steel);
    glb.object("screen", &rectangle(dvec3(-1.9, 0.0, -1.2), dvec3(1.7, 0.0, -0.5), DVec3::Y * 1.5), brass);
    glb.object("screen", &rectangle(dvec3(0.2, 0.0, -1.6), dvec3(1.8, 0.0, 0.6), DVec3::Y * 1.5), steel);
    glb.object("ball", &sphere(0.4, 36).translated(dvec3(0.0, 0.4, -0.2)), chalk);
    glb.object("ground", &floor(20.0).translated(dvec3(0.0, -0.01, 0.0)), chalk);
    glb.camera("camera", dvec3(0.3, 1.7, 4.6), dvec3(0.0, 0.5, -0.3), 36.0, 1.5);
    Ok(glb)
}

pub const BRUSHED_SKY: Sky = Sky {
    sun: dvec3(0.55, 0.45, 0.5),
    sun_radius: 1.5,
    sun_radiance: dvec3(1500.0, 1250.0, 950.0),
    zenith: dvec3(0.22, 0.38, 0.7),
    horizon: dvec3(0.7, 0.78, 0.85),
    ground: dvec3(0.2, 0.18, 0.15),
    glow: dvec3(0.8, 0.55, 0.3),
};

/// A tree of alpha-masked leaves, instanced, and a wall behind it, under a sky with sun.
pub fn foliage() -> Result<Glb, ImageError> {
    let mut glb = Glb::default();
    let picture = pictures::png(&pictures::masked(64, 64, |u, v| {
        let (x, y) = (2.0 * u - 1.0, 1.0 - v);
        let wave = 1.0 + 0.12 * (18.0 * y).sin();
        let inside = x.abs() < 0.62 * wave * (PI * y.powf(0.8)).sin().max(0.0);
        let vein = if x.abs() < 0.04 { 0.6 } else { 1.0 };
        let tone = vein * (0.8 + 0.4 * fractal(u, v, (6, 6), 2, 3));
        ([0.30 * tone, 0.52 * tone, 0.14 * tone], inside)
    }))?;
    let leaf = glb.texture("leaf", &picture, "image/png");
    let leaf = Material {
        color_texture: Some(leaf),
        double_sided: true,
        masked: true,
        ..Material::dielectric("leaf", [1.0; 3], 0.4)
    };
    let leaf = glb.material(&leaf);
    let bark = glb.material(&Material::lambert("bark", [0.16, 0.11, 0.07]));
    let wall = glb.material(&Material::lambert("wall", [0.62, 0.58, 0.50]));
    let soil = glb.material(&Material::lambert("soil", [0.18, 0.14, 0.09]));
    glb.object("ground", &floor(12.0), soil);
    glb.object("wall", &block(dvec3(9.0, 3.6, 0.3), dvec3(0.0, 0.0, -2.2), 0.0), wall);
    let mut random = Random(11);
    let trunk = [dvec3(0.0, 0.0, 0.0), dvec3(0.05, 0.8, 0.02), dvec3(-0.04, 1.7, -0.03), dvec3(0.05, 2.5, 0.0)];
    glb.object("trunk", &tube(&trunk, 10, false, |t| 0.11 - 0.08 * t), bark);
    let card = glb.geometry(&textured_rectangle(dvec3(-0.5, 0.0, 0.0), DVec3::X, DVec3::Y, dvec2(1.0, 1.0)));
    let card = glb.mesh("leaf", &[(&card, leaf)]);
    for _ in 0..900 {
        let at = random.direction() * random.unit().cbrt() * dvec3(1.15, 0.95, 1.0) + dvec3(0.0, 2.0, 0.0);
        let turn = DQuat::from_rotation_y(random.between(0.0, TAU)) * DQuat::from_rotation_x(random.between(-1.3, 0.9));
        glb.instance(card, &Placement { translation: at, rotation: turn, scale: random.between(0.2, 0.34) });
    }
    for _ in 0..160 {
        let at = dvec3(random.between(-2.6, 2.6), 0.01, random.between(-1.8, 1.8));
        let turn =
            DQuat::from_rotation_y(random.between(0.0, TAU)) * DQuat::from_rotation_x(random.between(-1.5, -1.1));
        glb.instance(card, &Placement { translation: at, rotation: turn, scale: random.between(0.14, 0.24) });
    }
    glb.camera("camera", dvec3(0.5, 1.9, 5.8), dvec3(0.0, 1.65, -0.3), 36.0, 1.5);
    Ok(glb)
}

pub const FOLIAGE_SKY: Sky = Sky {
    sun: dvec3(-0.45, 0.72, 0.55),
    sun_radius: 1.0,
    sun_radiance: dvec3(4200.0, 3700.0, 3000.0),
    zenith: dvec3(0.2, 0.36, 0.75),
    horizon: dvec3(0.75, 0.85, 0.95),
    ground: dvec3(0.15, 0.14, 0.1),
    glow: dvec3(0.4, 0.34, 0.24),
};
