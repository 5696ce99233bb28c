//! Random scenes as lists of named features, so that a scene can be told in a command and made smaller.
//!
//! A feature's random numbers follow from the scene's seed and its own name: it stays what it is where others are left out.

use std::fmt;
use std::sync::Arc;

use bismar::rays::Backend;
use bismar::render::settings::lens::{Aperture, Focus, LensSettings};
use bismar::render::{BackFaces, PixelFilter, RenderSettings};
use bismar::sampling::SplitMix64;
use bismar::sampling::random::mix;
use bismar::scene::build::{Shape, area_light, cuboid, glass, look, quad, sphere};
use bismar::scene::{
    AlphaMode, Environment, Instance, Material, Mesh, Motion, PunctualKind, PunctualLight, Scene, TextureSlot,
};
use glam::{Affine3A, DAffine3, DQuat, DVec3, Quat, Vec3, Vec4, dvec3, vec3};

use super::materials::{BODIES, SURFACES, between, make, textured};

struct Kind {
    name: &'static str,
    /// How often a random scene has one.
    often: f32,
    values: Values,
    apply: fn(&mut Canvas, &str, &mut SplitMix64),
}

enum Values {
    Surfaces,
    /// Materials of surfaces and of bodies.
    Materials,
    Of(&'static [&'static str]),
}

impl Values {
    fn all(&self) -> Vec<&'static str> {
        let surfaces = SURFACES.iter().map(|(name, _)| *name);
        match self {
            Self::Surfaces => surfaces.collect(),
            Self::Materials => surfaces.chain(BODIES.iter().map(|(name, _)| *name)).collect(),
            Self::Of(values) => values.to_vec(),
        }
    }
}

const fn kind(name: &'static str, often: f32, values: Values, apply: fn(&mut Canvas, &str, &mut SplitMix64)) -> Kind {
    Kind { name, often, values, apply }
}

/// What a random scene is made of, in the order in which it is made.
static KINDS: [Kind; 20] = [
    kind("room", 0.75, Values::Of(&["open", "open", "closed"]), |canvas, value, _| {
        canvas.room = Some(if value == "closed" { 3.5 } else { 1.0 });
    }),
    kind("floor", 0.7, Values::Surfaces, |canvas, value, _| canvas.floor = Some(value.into())),
    kind("back", 0.5, Values::Surfaces, |canvas, value, _| canvas.back = Some(value.into())),
    kind("side", 0.3, Values::Surfaces, |canvas, value, _| canvas.side = Some(value.into())),
    kind("ball", 0.5, Values::Materials, |canvas, value, random| {
        let shape = standing(sphere(between(random, [0.2, 0.4]).into(), 8), random);
        canvas.put(shape, value, random);
    }),
    kind("box", 0.4, Values::Materials, |canvas, value, random| {
        let [x, y, z] = [0; 3].map(|_| f64::from(between(random, [0.15, 0.4])));
        let turned = DQuat::from_rotation_y(random.f64() * 3.0);
        let shape = standing(cuboid(dvec3(-x, -y, -z), dvec3(x, y, z)).rotated(turned), random);
        canvas.put(shape, value, random);
    }),
    // Smooth normals on few triangles: far from the geometric ones.
    kind("facets", 0.25, Values::Surfaces, |canvas, value, random| {
        let shape = standing(sphere(between(random, [0.3, 0.5]).into(), 3), random);
        canvas.put(shape, value, random);
    }),
    kind("sheet", 0.3, Values::Surfaces, |canvas, value, random| {
        let shape = sheet(random);
        canvas.put(shape, value, random);
    }),
    kind("skins", 0.2, Values::Surfaces, |canvas, value, random| {
        let front = sheet(random);
        canvas.two_skins(front, value, random);
    }),
    kind("gap", 0.15, Values::Surfaces, |canvas, value, random| {
        let (gap, half) = (0.1f64.powi(3 + (random.f32() * 2.0) as i32), 0.5);
        let plate = level(half, -1.0 + gap, 0.3 * random.f64());
        canvas.put(plate, value, random);
    }),
    kind("nest", 0.15, Values::Of(&["lamp-inside", "ball-in-water", "touching", "overlapping", "air-in-glass"]), nest),
    kind("copies", 0.2, Values::Of(&["mirrored", "instanced"]), copies),
    kind(
        "lamp",
        0.55,
        Values::Of(&[
            "ceiling",
            "tiny",
            "many",
            "textured",
            "up",
            "skins",
            "double-sided",
            "blend",
            "ball",
            "bulb",
            "thin-bulb",
            "frosted-bulb",
            "behind-pane",
        ]),
        lamp,
    ),
    kind(
        "light",
        0.5,
        Values::Of(&["point", "spot", "low-spot", "sun", "sized-point", "sized-spot", "sized-sun"]),
        light,
    ),
    kind("sky", 0.3, Values::Of(&["grey", "hot", "studio"]), |canvas, value, random| {
        let sky = match value {
            "studio" => Environment::studio(),
            "grey" => Environment::constant([0.5; 3]),
            _ => {
                let (width, height, hot) = (32, 16, (random.f32() * 256.0) as usize);
                let pixels = (0..512).map(|i| [if i == hot { 600.0 } else { 0.2 }; 3]).collect();
                Environment { name: "hot".into(), width, height, pixels, rotation: 0.0, strength: 1.0 }
            }
        };
        canvas.scene.environment = Some(sky);
    }),
    kind("motion", 0.12, Values::Of(&["object", "camera"]), |canvas, value, random| {
        let by = dvec3(0.2, 0.1 * random.f64(), 0.0);
        let start = canvas.scene.cameras[0].to_world;
        let camera = DAffine3::from_mat3_translation(start.matrix3.as_dmat3(), start.translation.as_dvec3());
        let motion = |keys: [DAffine3; 2]| Motion::new(&keys).map(Arc::new);
        if value == "camera" {
            canvas.scene.cameras[0].motion = motion([camera, DAffine3::from_translation(by) * camera]);
        } else if let Some(instance) = canvas.scene.instances.last_mut().filter(|one| one.transform.is_none()) {
            instance.transform = Some(Affine3A::IDENTITY);
            instance.motion =
                motion([DAffine3::IDENTITY, DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.2), by)]);
        }
    }),
    kind("depth", 0.7, Values::Of(&["2", "3", "4", "5", "6", "7", "8"]), |canvas, value, _| {
        canvas.settings.max_depth = value.parse().unwrap_or(canvas.settings.max_depth);
    }),
    kind(
        "camera",
        0.4,
        Values::Of(&["box", "blackman-harris", "wide-open", "obvhs", "back-faces"]),
        |canvas, value, _| match value {
            "box" => canvas.settings.filter = PixelFilter::Box,
            "blackman-harris" => canvas.settings.filter = PixelFilter::BlackmanHarris,
            "wide-open" => {
                let (aperture, focus) = (Aperture::Radius(0.08), Focus::Distance(3.0));
                canvas.settings.lens = Some(LensSettings { aperture, focus, blades: 5 });
            }
            "obvhs" => canvas.rays = Backend::Obvhs,
            _ => canvas.settings.back_faces = BackFaces::Show,
        },
    ),
    kind("inside", 0.05, Values::Of(&["tinted-glass", "glass"]), |canvas, value, random| {
        // The camera is in a body around all.
        canvas.put(cuboid(DVec3::splat(-6.0), DVec3::splat(6.0)), value, random);
    }),
    kind(
        "walls",
        0.25,
        Values::Of(&["half-metal", "varnish", "polished-metal", "black-texels"]),
        |canvas, value, _| {
            for wall in [&mut canvas.floor, &mut canvas.back, &mut canvas.side] {
                *wall = Some(value.into());
            }
        },
    ),
];

/// A part of a scene or of how it is rendered; `KIND:VALUE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feature {
    kind: &'static str,
    value: &'static str,
}

impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}:{}", self.kind, self.value)
    }
}

/// Reads features with commas between.
pub fn features(text: &str) -> Result<Vec<Feature>, String> {
    let one = |text: &str| {
        let (kind, value) = text.split_once(':').unwrap_or((text, ""));
        let kinds = || KINDS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
        let found = KINDS.iter().find(|own| own.name == kind);
        let found = found.ok_or_else(|| format!("'{text}' is not KIND:VALUE; kinds are {}", kinds()))?;
        let values = found.values.all();
        let value = values.iter().find(|own| **own == value);
        let value = value.ok_or_else(|| format!("'{text}': values of {kind} are {}", values.join(", ")))?;
        Ok(Feature { kind: found.name, value })
    };
    text.split(',').map(|text| one(text.trim())).collect()
}

/// The features in a command.
pub fn joined(features: &[Feature]) -> String {
    features.iter().map(Feature::to_string).collect::<Vec<_>>().join(",")
}

/// Is a feature no part of a scene, but of how it is rendered?
fn is_setting(kind: &str) -> bool {
    ["depth", "camera"].contains(&kind)
}

/// Random features of a scene that has light, or only those of how a file is rendered.
pub fn draw(seed: u32, of_file: bool) -> Vec<Feature> {
    let mut random = stream(seed, "features");
    let mut found = Vec::new();
    for kind in KINDS.iter().filter(|kind| !of_file || is_setting(kind.name)) {
        let values = kind.values.all();
        let value = values[(random.f32() * values.len() as f32) as usize];
        if random.f32() < kind.often {
            found.push(Feature { kind: kind.name, value });
        }
    }
    if !of_file && !found.iter().any(|feature| ["lamp", "light", "sky"].contains(&feature.kind)) {
        found.push(Feature { kind: "lamp", value: "ceiling" });
    }
    found
}

/// Random numbers of a thing in a scene.
pub fn stream(seed: u32, name: &str) -> SplitMix64 {
    SplitMix64(name.bytes().fold(mix(seed.into()), |state, byte| mix(state ^ u64::from(byte))))
}

/// A scene under construction.
pub struct Canvas {
    pub scene: Scene,
    pub settings: RenderSettings,
    pub rays: Backend,
    /// A body within another of the same medium, which changes nothing.
    pub twin: Option<(Shape, Material)>,
    /// Where the room ends toward the camera, if there is one.
    room: Option<f64>,
    floor: Option<String>,
    back: Option<String>,
    side: Option<String>,
}

impl Canvas {
    /// The scene of these features, and how it is rendered. They are added to the scene of a file, if there is one.
    pub fn of(file: Option<Scene>, features: &[Feature], seed: u32, settings: RenderSettings) -> Self {
        let own = || {
            let mut scene = Scene::default();
            look(&mut scene, [0.0, 0.0, 3.2], [0.0; 3], 0.7);
            scene
        };
        let (scene, rays) = (file.unwrap_or_else(own), Backend::Embree);
        let mut canvas = Self { scene, settings, rays, twin: None, room: None, floor: None, back: None, side: None };
        // In the table's order, whatever the order of the features.
        for kind in &KINDS {
            for feature in features.iter().filter(|feature| feature.kind == kind.name) {
                (kind.apply)(&mut canvas, feature.value, &mut stream(seed, &feature.to_string()));
            }
        }
        canvas.walls(seed);
        if canvas.scene.moves() {
            // Obvhs knows no motion.
            canvas.rays = Backend::Embree;
        }
        canvas
    }

    /// Floor and walls: those that have a material, and in a room also the others.
    fn walls(&mut self, seed: u32) {
        let front = self.room.unwrap_or(1.0);
        let (low, high, x) = (-1.0, 1.0, [-1.0, 1.0]);
        let wall = |corners: [[f64; 3]; 4]| quad(corners.map(DVec3::from));
        let of = |y: f64, z: [f64; 2]| wall([[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]]);
        let upright = |z: f64, [a, b]: [f64; 2]| wall([[a, low, z], [b, low, z], [b, high, z], [a, high, z]]);
        let beside = |x: f64, [a, b]: [f64; 2]| wall([[x, low, a], [x, low, b], [x, high, b], [x, high, a]]);
        let plain = || self.room.map(|_| "diffuse".to_owned());
        let mut walls = vec![
            (of(low, [front, -1.0]), self.floor.clone().or_else(plain)),
            (upright(-1.0, x), self.back.clone().or_else(plain)),
            (beside(-1.0, [front, -1.0]), self.side.clone().or_else(plain)),
            (beside(1.0, [-1.0, front]), plain()),
            (of(high, [-1.0, front]), plain()),
        ];
        if front > 1.0 {
            walls.push((upright(front, [1.0, -1.0]), plain()));
        }
        for (i, (shape, material)) in walls.into_iter().enumerate() {
            if let Some(name) = material {
                self.put(shape, &name, &mut stream(seed, &format!("wall {i} {name}")));
            }
        }
    }

    /// Adds a shape with a material of a name, single-sided or not.
    fn put(&mut self, shape: Shape, name: &str, random: &mut SplitMix64) {
        let double_sided = random.f32() < 0.5;
        let material = make(name, &mut self.scene, random);
        self.add(shape, Material { double_sided, ..material }, random);
    }

    /// Adds a shape with what its material needs.
    fn add(&mut self, shape: Shape, material: Material, random: &mut SplitMix64) {
        let Shape { positions, normals, triangles, .. } = shape;
        let floats = |v: &DVec3| v.as_vec3().to_array();
        let mut of_vertices = normals.clone();
        if normals.is_empty() {
            of_vertices = vec![DVec3::Y; positions.len()];
            for triangle in &triangles {
                let [a, b, c] = triangle.map(|i| positions[i as usize]);
                triangle.iter().for_each(|i| of_vertices[*i as usize] = (b - a).cross(c - a).normalize_or(DVec3::Y));
            }
        }
        let tangent = |n: &DVec3| n.any_orthonormal_vector().as_vec3().extend(1.0).to_array();
        let color = |_: &DVec3| [0; 3].map(|_| random.f32());
        let textured = material.textures.iter().next().is_some();
        let colors: Vec<_> = positions.iter().map(color).collect();
        let mesh = Mesh {
            normals: (!normals.is_empty()).then(|| normals.iter().map(floats).collect()),
            tangents: material.tangent_sets()[0].map(|_| of_vertices.iter().map(tangent).collect()),
            colors: (material.name == "vertex-colors")
                .then(|| colors.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect()),
            texcoords: [
                textured.then(|| {
                    positions.iter().map(|p| [p.x + 0.37 * p.y, p.z + 0.61 * p.y].map(|x| x as f32)).collect()
                }),
                None,
            ],
            ..Mesh::new(positions.iter().map(floats).collect(), triangles)
        };
        self.scene.add(mesh, material);
    }

    /// A sheet of two single-sided skins in one plane, the second diffuse.
    fn two_skins(&mut self, front: Shape, value: &str, random: &mut SplitMix64) {
        let mut back = front.clone();
        back.triangles.iter_mut().for_each(|triangle| triangle.reverse());
        let lamp = value == "lamp";
        for (shape, name) in [(front, value), (back, if lamp { "lamp" } else { "diffuse" })] {
            let material = if lamp { area_light(4.0) } else { make(name, &mut self.scene, random) };
            self.add(shape, Material { double_sided: false, ..material }, random);
        }
    }
}

/// Moves a shape to a random place on the floor, which it touches or is a little above.
fn standing(shape: Shape, random: &mut SplitMix64) -> Shape {
    let low = shape.positions.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    let at = dvec3(1.2 * random.f64() - 0.6, -1.0 - low + 0.01 * random.f64(), 1.2 * random.f64() - 0.7);
    shape.translated(at)
}

/// An upright square in the middle of the scene, of which the camera sees either side.
fn sheet(random: &mut SplitMix64) -> Shape {
    let half = f64::from(between(random, [0.3, 0.6]));
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| dvec3(x, y, 0.0));
    let turned = DQuat::from_rotation_y(random.f64() * 6.3);
    quad(corners).rotated(turned).translated(dvec3(0.8 * random.f64() - 0.4, -0.3, 0.8 * random.f64() - 0.5))
}

/// A level square of half width `half`, facing up.
fn level(half: f64, y: f64, x: f64) -> Shape {
    quad([[-half, half], [half, half], [half, -half], [-half, -half]].map(|[dx, z]| dvec3(x + dx, y, z)))
}

/// A level square that faces down.
fn facing_down(half: f64, [x, y, z]: [f64; 3]) -> Shape {
    quad([[-half, -half], [half, -half], [half, half], [-half, half]].map(|[dx, dz]| dvec3(x + dx, y, z + dz)))
}

fn nest(canvas: &mut Canvas, value: &str, random: &mut SplitMix64) {
    let at = dvec3(0.6 * random.f64() - 0.3, -0.5, 0.4 * random.f64());
    let ball = |radius: f64, x: f64| sphere(radius, 6).translated(at + DVec3::X * x);
    let tinted = |absorption: f32, ior| Material { absorption: vec3(absorption, 0.3, 1.0), ..glass(ior, 0.0) };
    let mut air = ball(0.3, 0.0);
    air.triangles.iter_mut().for_each(|triangle| triangle.reverse());
    air.normals.iter_mut().for_each(|normal| *normal = -*normal);
    let bodies = match value {
        "lamp-inside" => vec![(ball(0.4, 0.0), tinted(2.0, 1.5)), (ball(0.1, 0.0), area_light(12.0))],
        "ball-in-water" => vec![(ball(0.45, 0.0), tinted(1.0, 1.33)), (ball(0.2, 0.1), tinted(3.0, 1.5))],
        "touching" => vec![(ball(0.25, -0.25), tinted(2.0, 1.5)), (ball(0.25, 0.25), tinted(0.2, 1.5))],
        "overlapping" => vec![(ball(0.35, -0.15), tinted(2.0, 1.5)), (ball(0.35, 0.15), tinted(0.2, 1.5))],
        _ => vec![(ball(0.4, 0.0), tinted(1.0, 1.5)), (air, tinted(1.0, 1.5))],
    };
    // Around what is within; no boundary crosses it. Air in glass, within two bodies, would leave one of them.
    if !["overlapping", "air-in-glass"].contains(&value)
        && !canvas.scene.materials.iter().any(|material| material.bounds_medium)
    {
        let (shape, material) = bodies[0].clone();
        let centre = shape.positions.iter().sum::<DVec3>() / shape.positions.len() as f64;
        canvas.twin = Some((shape.translated(-centre).scaled(0.875).translated(centre), material));
    }
    bodies.into_iter().for_each(|(shape, material)| canvas.add(shape, material, random));
}

/// Another placement of the last object.
fn copies(canvas: &mut Canvas, value: &str, random: &mut SplitMix64) {
    let Some(Instance { object, .. }) = canvas.scene.instances.last().cloned() else { return };
    // A copied body may cross it.
    canvas.twin = None;
    let scale = if value == "mirrored" { vec3(-1.0, 1.0, 1.0) } else { vec3(0.6, 0.8, 0.7) };
    let turn = Quat::from_rotation_y(between(random, [0.0, 0.5]));
    let to = Affine3A::from_scale_rotation_translation(scale, turn, vec3(between(random, [-0.2, 0.2]), 0.3, -0.2));
    canvas.scene.instances.push(Instance { name: "copy".into(), object, transform: Some(to), ..Default::default() });
}

fn lamp(canvas: &mut Canvas, value: &str, random: &mut SplitMix64) {
    let at = [0.8 * random.f64() - 0.4, 0.97, 0.8 * random.f64() - 0.4];
    let bulb = DVec3::from(at) - DVec3::Y * 0.6;
    let both = |material: Material| Material { double_sided: true, ..material };
    let shell = |roughness, bounds_medium| Material { bounds_medium, ..glass(1.5, roughness) };
    let ball = |radius: f64| sphere(radius, 6).translated(bulb);
    let mut lamps = match value {
        "ceiling" => vec![(facing_down(0.3, at), area_light(8.0))],
        "tiny" => vec![(facing_down(0.02, at), area_light(900.0))],
        "many" => {
            let one = |_| {
                let (half, [x, y, z]) = (0.01 + 0.1 * random.f64().powi(2), [random.f64(), random.f64(), random.f64()]);
                let place = [1.8 * x - 0.9, 0.98 - 0.6 * y * y, 1.8 * z - 0.9];
                (facing_down(half, place), area_light((0.02 / (half * half)) as f32))
            };
            (0..12).map(one).collect()
        }
        "textured" => {
            let some = |random: &mut SplitMix64| [if random.f32() < 0.8 { 0 } else { 255 }; 3];
            vec![(
                facing_down(0.3, at),
                textured(&mut canvas.scene, random, area_light(40.0), TextureSlot::Emissive, some),
            )]
        }
        "up" => vec![(level(0.3, 0.6, at[0]), area_light(12.0))],
        "double-sided" => vec![(sheet(random), both(area_light(3.0)))],
        "blend" => {
            let base_color = Vec4::new(0.0, 0.0, 0.0, 0.4);
            vec![(facing_down(0.3, at), Material { base_color, alpha_mode: AlphaMode::Blend, ..area_light(20.0) })]
        }
        "ball" => vec![(ball(0.15), area_light(8.0))],
        "bulb" => vec![(ball(0.08), area_light(30.0)), (ball(0.2), shell(0.0, true))],
        "thin-bulb" => vec![(ball(0.08), area_light(30.0)), (ball(0.2), shell(0.0, false))],
        "frosted-bulb" => vec![(ball(0.08), area_light(30.0)), (ball(0.2), shell(0.3, true))],
        "behind-pane" => {
            let pane = both(shell(0.0, false));
            vec![(facing_down(0.25, at), area_light(8.0)), (facing_down(0.5, [at[0], 0.8, at[2]]), pane)]
        }
        _ => {
            let front = sheet(random);
            canvas.two_skins(front, "lamp", random);
            Vec::new()
        }
    };
    lamps.drain(..).for_each(|(shape, material)| canvas.add(shape, material, random));
}

fn light(canvas: &mut Canvas, value: &str, random: &mut SplitMix64) {
    let spot = |outer| PunctualKind::Spot { inner: 0.5 * outer, outer };
    let place = vec3(between(random, [-0.5, 0.5]), 0.5, between(random, [-0.5, 0.5]));
    let aside = vec3(between(random, [-0.4, 0.4]), -1.0, between(random, [-0.4, 0.4])).normalize();
    let (kind, power, position, direction, size) = match value {
        "point" => (PunctualKind::Point, 0.8, place, aside, 0.0),
        "spot" => (spot(0.5), 4.0, place, aside, 0.0),
        // Along the back wall and up.
        "low-spot" => (spot(0.4), 3.0, vec3(0.0, 0.2, -0.72), vec3(0.2, 0.97, -0.1).normalize(), 0.0),
        "sun" => (PunctualKind::Directional, 2.0, Vec3::ZERO, vec3(0.3, -0.5, -0.8).normalize(), 0.0),
        "sized-point" => (PunctualKind::Point, 0.8, place, aside, 0.1),
        "sized-spot" => (spot(0.6), 3.0, place, aside, 0.15),
        _ => (PunctualKind::Directional, 2.0, Vec3::ZERO, vec3(-0.2, -0.5, -0.8).normalize(), 0.1),
    };
    let (intensity, range, motion) = (Vec3::splat(power), f32::INFINITY, Vec::new());
    canvas.scene.lights.push(PunctualLight {
        name: "light".into(),
        kind,
        intensity,
        position,
        direction,
        range,
        size,
        motion,
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_feature_makes_a_scene_by_itself_and_is_what_its_name_says() {
        for kind in &KINDS {
            for value in kind.values.all() {
                let text = format!("{}:{value}", kind.name);
                let features = features(&text).unwrap();
                assert_eq!(joined(&features), text);
                let Canvas { scene, settings, .. } = Canvas::of(None, &features, 7, RenderSettings::default());
                settings.validate(&scene).unwrap();
                for mesh in &scene.meshes {
                    let n = mesh.positions.len() as u32;
                    assert!(mesh.indices.iter().flatten().all(|i| *i < n), "{text}");
                    let textured = scene.materials[mesh.material as usize].textures.iter().next().is_some();
                    assert_eq!(textured, mesh.texcoords[0].is_some(), "{text}");
                }
            }
        }
        for bad in ["", "room", "room:", "room:round", "walls:open", "floor:glass"] {
            assert!(features(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_feature_stays_what_it_is_where_others_are_left_out() {
        let all = features("room:open,floor:bumps,ball:plastic,sheet:leaf,light:spot").unwrap();
        let settings = RenderSettings::default();
        let position = |features: &[Feature]| {
            let Canvas { scene, .. } = Canvas::of(None, features, 3, settings.clone());
            scene.meshes.iter().find(|mesh| mesh.positions.len() > 100).unwrap().positions.to_vec()
        };
        assert_eq!(position(&all), position(&all[2..3]));
        // Each of them is in some of four thousand scenes.
        let drawn: Vec<_> = (0..4000).flat_map(|seed| draw(seed, false)).map(|feature| feature.to_string()).collect();
        for kind in &KINDS {
            for value in kind.values.all() {
                let text = format!("{}:{value}", kind.name);
                assert!(drawn.iter().filter(|own| **own == text).count() >= 3, "{text}");
            }
        }
    }
}
