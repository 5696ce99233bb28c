//! The ways to render a scene that must have one mean, and their pictures.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::Balance;
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::{Choice, Choices, LightGroups, Part, RenderSettings, Rendered, Technique, render, tile_positions};
use bismar::sampling::random::mix;
use bismar::scene::build::add_shape;
use rayon::prelude::*;

use super::features::{Canvas, stream};

/// Pixels of a picture, and along a side of a block of pixels that is tested.
pub const SIZE: [u32; 2] = [24, 16];
const BLOCK: u32 = 8;
/// Number of tested values of a picture: its mean, and those of its blocks.
pub const REGIONS: usize = 1 + (SIZE[0] / BLOCK * (SIZE[1] / BLOCK)) as usize;
/// How many times as many paths the reference has.
const REFERENCE: u32 = 4;
/// The control of lost light: of so many paths the brightest is lost, in so large a part of the pixels.
pub const LOST_OF: u32 = 200;
const LOST_PIXELS: f64 = 0.1;

/// How a way renders, besides its settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Means {
    Whole,
    Parts,
    /// The sum of the groups of lights.
    Groups,
    /// Objects and triangles in the opposite order, with a twin of a body within it, by the other ray library.
    Reversed,
}

#[derive(Debug, Clone)]
pub struct Way {
    pub name: String,
    settings: RenderSettings,
    means: Means,
}

impl Way {
    /// `--balance half` with more paths, which the others are compared with.
    pub fn reference(settings: &RenderSettings) -> Self {
        let spp = settings.spp.map(|spp| REFERENCE * spp);
        let settings = RenderSettings { balance: Balance::Half, techniques: Choices::even(), spp, ..settings.clone() };
        Self { name: "half".into(), settings, means: Means::Whole }
    }

    /// The plain command, its balance alone, each technique alone, all of them, another order, and one more that chance chooses.
    pub fn all(stage: &Stage, seed: u32) -> Vec<Self> {
        let Stage { scene, settings, .. } = stage;
        let of = |name: &str, balance, techniques: Choices| {
            let settings = RenderSettings { balance, techniques, ..settings.clone() };
            Self { name: name.into(), settings, means: Means::Whole }
        };
        let plain = RenderSettings::default();
        let only = |one: Option<Technique>| Choices::new(|own| Choice::from(one == Some(own)));
        // Elsewhere it warns.
        let shares = !scene.scene.moves() && settings.clamp_indirect.is_none();
        let possible = |one: Technique| one != Technique::PathReuse || shares;
        let mut ways = vec![
            of("plain", plain.balance, plain.techniques),
            of(plain.balance.name(), plain.balance, only(None)),
            of("all", plain.balance, Choices::new(|one| Choice::from(possible(one)))),
        ];
        let alone = |one: &Technique| of(&format!("half+{}", one.row().flag), Balance::Half, only(Some(*one)));
        ways.extend(Technique::ALL.iter().filter(|one| possible(**one)).map(alone));
        ways.push(Self { means: Means::Reversed, name: "half, reversed".into(), ..of("", Balance::Half, only(None)) });
        let mut random = stream(seed, "way");
        let mut draw = |n: usize| (random.f32() * n as f32) as usize;
        let base = [0, 2][draw(2)];
        let name = ways[base].name.clone();
        let with = |more: &str, change: &dyn Fn(&mut RenderSettings), means| {
            let mut settings = ways[base].settings.clone();
            change(&mut settings);
            Self { name: format!("{name}, {more}"), settings, means }
        };
        let goal = [0.05, 0.1, 0.2, 0.4][draw(4)];
        let more = match draw(6) {
            0..=2 => with(
                "--noise",
                &|settings| (settings.noise, settings.spp) = (Some(goal), settings.spp.map(|spp| 8 * spp)),
                Means::Whole,
            ),
            3 => with("parts", &|_| (), Means::Parts),
            _ => with("light groups", &|settings| settings.light_groups = Some(LightGroups::kinds()), Means::Groups),
        };
        ways.push(more);
        let others = Balance::all().iter().filter(|own| ![Balance::Half, plain.balance].contains(own));
        let others: Vec<_> = others.map(|own| of(own.name(), *own, only(None))).collect();
        ways.extend(others.get(draw(others.len())).cloned());
        // Without motion, which obvhs does not know.
        ways.retain(|way| way.means != Means::Reversed || stage.reversed.is_some());
        ways
    }
}

/// A scene that is ready to be rendered in all ways.
pub struct Stage {
    pub scene: PreparedScene<'static>,
    reversed: Option<PreparedScene<'static>>,
    pub settings: RenderSettings,
}

impl Stage {
    pub fn new(canvas: Canvas) -> Result<Self> {
        let Canvas { scene, settings, rays, twin, .. } = canvas;
        let mut reversed = scene.clone();
        twin.iter().for_each(|(shape, material)| add_shape(&mut reversed, shape, material.clone()));
        reversed.instances.reverse();
        reversed.meshes.iter_mut().for_each(|mesh| Arc::make_mut(mesh).indices.reverse());
        let other = if rays == Backend::Obvhs { Backend::Embree } else { Backend::Obvhs };
        let moves = scene.moves();
        let reversed = (!moves).then(|| PreparedScene::build(Arc::new(reversed), other)).transpose()?;
        let scene = PreparedScene::build(Arc::new(scene), rays)?;
        Ok(Self { scene, reversed, settings })
    }

    /// The brightest radiance that a light has, as far as a path can meet it. A light without a size is met from a tenth of a
    /// metre and more, or always.
    pub fn brightest(&self) -> f64 {
        let scene = &self.scene.scene;
        let surfaces = scene.materials.iter().map(|material| material.emissive.max_element());
        let sky = scene.environment.iter().flat_map(|sky| sky.pixels.iter().flatten().map(|x| x * sky.strength));
        let area = |size: f32| std::f32::consts::PI * size.max(0.1).powi(2);
        let lights = scene.lights.iter().map(|light| light.intensity.max_element() / area(light.size));
        surfaces.chain(sky).chain(lights).fold(0.0, f32::max).into()
    }

    /// Pictures of a way, one per seed.
    pub fn pictures(&self, way: &Way, seeds: std::ops::Range<u32>, stop: &AtomicBool) -> Result<Vec<Picture>> {
        seeds.into_par_iter().map(|seed| self.picture(way, seed, stop)).collect()
    }

    fn picture(&self, way: &Way, seed: u32, stop: &AtomicBool) -> Result<Picture> {
        let settings = RenderSettings { seed, ..way.settings.clone() };
        let of = |scene: &PreparedScene, settings: &RenderSettings| render(scene, settings, stop, &|_| ());
        let mut picture = Picture::new(seed);
        match (way.means, &self.reversed) {
            (Means::Parts, _) => {
                for number in [1, 2] {
                    let part = Some(Part { number, of: 2 });
                    picture.add(&of(&self.scene, &RenderSettings { part, ..settings.clone() })?, false);
                }
            }
            (Means::Reversed, Some(reversed)) => picture.add(&of(reversed, &settings)?, false),
            (means, _) => picture.add(&of(&self.scene, &settings)?, means == Means::Groups),
        }
        Ok(picture)
    }
}

/// What is tested of a picture: mean radiance over channels, of the whole and of each block.
#[derive(Debug, Clone)]
pub struct Picture {
    seed: u32,
    pub regions: [f64; REGIONS],
    /// The same without the light of the control.
    pub robbed: [f64; REGIONS],
    /// Luminance of the brightest path of each pixel, by block.
    pub peaks: Vec<Vec<f32>>,
    /// Paths per pixel.
    pub paths: f64,
}

impl Picture {
    /// One without pixels.
    pub fn new(seed: u32) -> Self {
        Self { seed, regions: [0.0; REGIONS], robbed: [0.0; REGIONS], peaks: vec![Vec::new(); REGIONS - 1], paths: 0.0 }
    }

    /// The brightest paths of a region's pixels.
    pub fn peaks_of(&self, region: usize) -> impl Iterator<Item = &f32> {
        let blocks = if region == 0 { &self.peaks[..] } else { &self.peaks[region - 1..region] };
        blocks.iter().flatten()
    }

    fn add(&mut self, rendered: &Rendered, by_groups: bool) {
        debug_assert_eq!(rendered.tiles.len(), tile_positions(&rendered.settings).len());
        for tile in &rendered.tiles {
            let layers = tile.layers.len() / tile.pixels();
            for (x, y, i) in tile.inside([0, 0, SIZE[0], SIZE[1]]) {
                let (stats, mut sum) = (&tile.stats[i], tile.stats[i].sum);
                if by_groups {
                    let of = |c: usize| tile.layers[layers * i..][..layers].iter().map(|own| f64::from(own[c])).sum();
                    sum = [0, 1, 2].map(of);
                }
                self.pixel([x, y], sum, stats.samples, tile.peaks[i].luminance);
            }
        }
    }

    /// Adds a pixel: sum and number of its paths, and the luminance of the brightest.
    fn pixel(&mut self, [x, y]: [u32; 2], sum: [f64; 3], samples: u32, peak: f32) {
        let (block, n) = (y / BLOCK * (SIZE[0] / BLOCK) + x / BLOCK, f64::from(samples.max(1)));
        let value = sum.iter().sum::<f64>() / (3.0 * n);
        // Lost pixels are one block and a part of the next; of few paths, one is among the LOST_OF as often.
        let place = block * BLOCK * BLOCK + y % BLOCK * BLOCK + x % BLOCK;
        let pixels = f64::from(SIZE[0] * SIZE[1]);
        let chance = mix(u64::from(self.seed) << 32 | u64::from(place)) % u64::from(LOST_OF);
        let lost = f64::from(place) < LOST_PIXELS * pixels && chance < u64::from(samples);
        let robbed = value - if lost { (f64::from(peak) / n).min(value) } else { 0.0 };
        for (regions, value) in [(&mut self.regions, value), (&mut self.robbed, robbed)] {
            regions[0] += value / pixels;
            regions[1 + block as usize] += value / f64::from(BLOCK * BLOCK);
        }
        self.peaks[block as usize].push(peak);
        self.paths += n / pixels;
    }
}
