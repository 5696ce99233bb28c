//! Small scenes for tests, and statistics of many renders of them.
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::{RenderSettings, Rendered, render};
pub use bismar::scene::build::{area_light, glass, lambert, look, metal};
use bismar::scene::{
    Deformation, Environment, Instance, LightKey, Material, Mesh, Motion, PunctualKind, PunctualLight, Scene, build,
};
use glam::{Affine3A, DAffine3, DQuat, DVec3, Vec3};

use super::statistics::Mean;

/// Adds a mesh with its own object and instance.
pub fn add(scene: &mut Scene, points: Vec<[f32; 3]>, indices: Vec<[u32; 3]>, material: Material) {
    scene.add(Mesh::new(points, indices), material);
}

/// A rectangle at height `y`, facing up or down.
pub fn rectangle(scene: &mut Scene, y: f32, [x0, x1]: [f32; 2], [z0, z1]: [f32; 2], up: bool, material: Material) {
    let points = vec![[x0, y, z0], [x0, y, z1], [x1, y, z1], [x1, y, z0]];
    let indices = if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] };
    add(scene, points, indices, material);
}

/// Vertices and triangles of a flat-shaded sphere of `n` rows and `2n` columns.
pub fn sphere(n: u32, radius: f32, center: Vec3) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let shape = build::sphere(radius.into(), n).translated(center.as_dvec3());
    (shape.positions.iter().map(|p| p.as_vec3().to_array()).collect(), shape.triangles)
}

/// Adds [`sphere`].
pub fn add_sphere(scene: &mut Scene, n: u32, radius: f32, center: Vec3, material: Material) {
    let (points, indices) = sphere(n, radius, center);
    add(scene, points, indices, material);
}

pub fn closed_box(scene: &mut Scene, low: Vec3, high: Vec3, material: Material) {
    build::add_shape(scene, &build::cuboid(low.as_dvec3(), high.as_dvec3()), material);
}

/// [`hall`] with an absorbing glass sphere around an area light, thin walls, and one surface for each further material lobe.
pub fn glass_hall() -> Arc<Scene> {
    let mut scene = Arc::unwrap_or_clone(hall());
    let absorbing = Material { absorption: Vec3::new(1.0, 0.3, 2.0), dispersion: 3.0, ..glass(1.5, 0.5) };
    let center = Vec3::new(-0.9, 0.7, 1.2);
    for (radius, material) in [(0.5, absorbing), (0.25, area_light(2.0)), (0.3, lambert(0.5))] {
        let aside = if radius == 0.3 { Vec3::X } else { Vec3::ZERO };
        add_sphere(&mut scene, 6, radius, center + aside, material);
    }
    let wall = |roughness, transmission| Material { bounds_medium: false, transmission, ..glass(1.5, roughness) };
    let points = vec![[0.3, 0.0, 1.8], [1.2, 0.0, 1.6], [1.2, 1.2, 1.6], [0.3, 1.2, 1.8]];
    add(&mut scene, points, vec![[0, 1, 2], [0, 2, 3]], wall(0.5, 1.0));
    let coated = Material { clearcoat: 0.7, sheen_color: Vec3::splat(0.4), sheen_roughness: 0.5, ..wall(0.4, 0.5) };
    rectangle(&mut scene, 1.6, [-1.0, 1.0], [-0.5, 1.0], true, coated);
    let leaf = Material { diffuse_transmission: 0.5, ..lambert(0.8) };
    rectangle(&mut scene, 1.3, [-1.5, -0.8], [-0.2, 0.6], true, leaf);
    let brushed = Material { anisotropy: 0.8, anisotropy_rotation: 0.5, iridescence: 0.8, ..metal(0.3) };
    rectangle(&mut scene, 1.0, [-1.7, -1.0], [-0.9, -0.3], true, brushed);
    std::sync::Arc::make_mut(scene.meshes.last_mut().unwrap()).tangents = Some(vec![[1.0, 0.0, 0.0, 1.0]; 4]);
    let pane = Material { clearcoat: 0.3, sheen_color: Vec3::splat(0.1), ..wall(0.0, 0.8) };
    for (z, material) in [(1.9, pane.clone()), (2.0, Material { iridescence: 1.0, emissive: Vec3::splat(0.1), ..pane })]
    {
        let points = vec![[-1.9, 0.0, z], [-0.3, 0.0, z], [-0.3, 1.4, z], [-1.9, 1.4, z]];
        add(&mut scene, points, vec![[0, 1, 2], [0, 2, 3]], material);
    }
    let bubble = Material { iridescence: 1.0, ..wall(0.4, 0.9) };
    rectangle(&mut scene, 0.6, [1.0, 1.7], [-0.9, 0.3], true, bubble);
    Arc::new(scene)
}

/// [`glass_hall`] with bodies of smooth glass: an absorbing globe around a lamp, a box with a film, a punctual light.
pub fn globe_hall() -> Arc<Scene> {
    let mut scene = Arc::unwrap_or_clone(glass_hall());
    let absorbing = Material { absorption: Vec3::new(1.0, 0.3, 2.0), ..glass(1.5, 0.0) };
    let center = Vec3::new(1.6, 0.5, 0.8);
    for (radius, material) in [(0.4, absorbing.clone()), (0.1, area_light(9.0))] {
        add_sphere(&mut scene, 6, radius, center, material);
    }
    let film = Material { iridescence: 1.0, emissive: Vec3::splat(0.2), ..absorbing };
    closed_box(&mut scene, Vec3::new(-0.3, 0.1, 1.5), Vec3::new(0.2, 0.5, 1.9), film);
    scene.lights.push(punctual(PunctualKind::Point, 2.0, Vec3::new(0.4, 1.8, 2.4), Vec3::NEG_Y));
    Arc::new(scene)
}

/// [`hall`] under water, with the camera and the lamp in it: a globe of glass around a body of another medium, and two boxes that touch.
pub fn pool() -> Arc<Scene> {
    let mut scene = Arc::unwrap_or_clone(hall());
    let medium = |ior, absorption| Material { absorption, ..glass(ior, 0.0) };
    let water = medium(1.33, Vec3::new(0.1, 0.05, 0.02));
    closed_box(&mut scene, Vec3::new(-5.0, -0.5, -5.0), Vec3::new(5.0, 2.5, 5.0), water.clone());
    for (radius, material) in [(0.4, glass(1.5, 0.0)), (0.25, medium(1.4, Vec3::new(3.0, 1.0, 0.2)))] {
        add_sphere(&mut scene, 6, radius, Vec3::new(-0.9, 0.7, 1.2), material);
    }
    let dark = medium(1.5, Vec3::new(0.5, 1.0, 2.0));
    closed_box(&mut scene, Vec3::new(0.5, 0.1, 1.3), Vec3::new(0.8, 0.5, 1.7), dark.clone());
    closed_box(&mut scene, Vec3::new(0.8, 0.1, 1.3), Vec3::new(1.1, 0.5, 1.7), water);
    // It reaches out of the water.
    closed_box(&mut scene, Vec3::new(-2.0, 1.9, -1.0), Vec3::new(-1.0, 2.8, 0.0), Material { roughness: 0.4, ..dark });
    scene.lights.push(punctual(PunctualKind::Point, 2.0, Vec3::new(0.4, 1.8, 2.4), Vec3::NEG_Y));
    Arc::new(scene)
}

/// A metal sphere on a diffuse floor under an area light and a grey environment.
pub fn hall() -> Arc<Scene> {
    let mut scene = Scene { environment: Some(Environment::constant([0.3; 3])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.6));
    rectangle(&mut scene, 2.0, [-0.4, 0.4], [-0.9, -0.3], false, area_light(9.0));
    add_sphere(&mut scene, 8, 0.6, Vec3::new(0.0, 0.6, 0.0), metal(0.4));
    look(&mut scene, Vec3::new(0.0, 1.2, 4.0), Vec3::new(0.0, 0.5, 0.0), 0.6);
    Arc::new(scene)
}

/// A punctual light without a size.
pub fn punctual(kind: PunctualKind, intensity: f32, position: Vec3, direction: Vec3) -> PunctualLight {
    let (name, range, motion) = ("lamp".into(), f32::INFINITY, Vec::new());
    PunctualLight { name, kind, intensity: Vec3::splat(intensity), position, direction, range, size: 0.0, motion }
}

/// A motion from identity that rotates about +y and translates.
pub fn turning(angle: f64, by: Vec3) -> Option<Arc<Motion>> {
    let end = DAffine3::from_rotation_translation(DQuat::from_rotation_y(angle), by.as_dvec3());
    Motion::new(&[DAffine3::IDENTITY, end]).map(Arc::new)
}

/// Gives the last instance a transform and a motion.
pub fn set_in_motion(scene: &mut Scene, motion: Option<Arc<Motion>>) {
    move_instance(scene.instances.last_mut().unwrap(), motion);
}

fn move_instance(instance: &mut Instance, motion: Option<Arc<Motion>>) {
    (instance.transform, instance.motion) = (Some(Affine3A::IDENTITY), motion);
}

/// [`hall`] with motion of everything: the sphere rotates, lights and camera move, the floor deforms.
pub fn moving_hall() -> Arc<Scene> {
    let mut scene = Arc::unwrap_or_clone(hall());
    let floor = Arc::make_mut(&mut scene.meshes[0]);
    let mut bulging = floor.positions.clone();
    bulging.as_mut_slice()[0][1] += 0.4;
    floor.motion = Some(Deformation { positions: vec![floor.positions.clone(), bulging], normals: Vec::new() });
    move_instance(&mut scene.instances[1], turning(0.7, Vec3::new(0.5, -0.2, 0.3)));
    move_instance(&mut scene.instances[2], turning(1.5, Vec3::new(0.3, 0.1, 0.0)));
    let key = |x| LightKey { intensity: Vec3::splat(2.0), position: Vec3::new(x, 1.5, 1.0), direction: Vec3::NEG_Y };
    let light = punctual(PunctualKind::Point, 2.0, Vec3::new(0.5, 1.5, 1.0), Vec3::NEG_Y);
    scene.lights.push(PunctualLight { motion: vec![key(-0.5), key(1.5)], ..light });
    let stand = |x| DAffine3::from_translation(DVec3::new(x, 1.2, 4.0));
    scene.cameras[0].motion = Motion::new(&[stand(0.0), stand(0.2)]).map(Arc::new);
    Arc::new(scene)
}

/// A scene that is prepared for rendering.
pub struct Stage {
    pub scene: PreparedScene<'static>,
}

impl Stage {
    pub fn new(scene: Arc<Scene>, backend: Backend) -> Self {
        Self { scene: PreparedScene::build(scene, backend).unwrap() }
    }

    pub fn render(&self, settings: &RenderSettings) -> Rendered {
        render(&self.scene, settings, &AtomicBool::new(false), &|_| ()).unwrap()
    }

    pub fn render_on(&self, threads: usize, settings: &RenderSettings) -> Rendered {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| self.render(settings))
    }

    /// Green of each pixel.
    pub fn green(&self, settings: &RenderSettings) -> Vec<f64> {
        self.channel(settings, 1)
    }

    fn channel(&self, settings: &RenderSettings, channel: usize) -> Vec<f64> {
        self.render(settings).film().pixels.iter().map(|p| p.sum[channel] / f64::from(p.samples)).collect()
    }

    /// Mean over `replicas` renders of the picture's mean green, with seeds from `settings.seed` on.
    pub fn mean_green(&self, settings: &RenderSettings, replicas: u32) -> Mean {
        self.mean_channel(settings, replicas, 1)
    }

    /// Mean over `replicas` renders of the mean of a channel (0 to 2).
    pub fn mean_channel(&self, settings: &RenderSettings, replicas: u32, channel: usize) -> Mean {
        let mut mean = Mean::default();
        for r in 0..replicas {
            let pixels = self.channel(&RenderSettings { seed: settings.seed + r, ..settings.clone() }, channel);
            mean.add(pixels.iter().sum::<f64>() / pixels.len() as f64);
        }
        mean
    }
}
