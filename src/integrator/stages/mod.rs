//! What happens between two ray queries, stage by stage: what the hits emit ([`hits`]), which shadow rays follow
//! ([`lights`]), which next rays ([`scatter`]).

pub mod hits;
pub mod lights;
pub mod scatter;

use glam::Vec3;

use super::Transport;
use super::wave::Wave;
use crate::balance::Counts;
use crate::lanes::{F, LANES, Rows, U, V3, eight, load_bits};

/// Whose samples are to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Technique {
    Light,
    Bsdf,
}

/// Up to eight samples to take.
struct TaskGroup {
    /// At which vertices.
    rows: Rows,
    /// Which point of its pixel's sequence each one is.
    index: U,
    seed: U,
    slot: U,
    child: U,
    /// What the light samples are toward.
    kind: U,
    /// How many count.
    len: usize,
    /// Samples a path: toward the environment, toward area lights, of the BSDF.
    rates: [F; 3],
}

/// What a light sample is toward: not known before it draws.
pub(super) const DRAWN: u32 = 0;
/// Toward the environment.
pub(super) const ENVIRONMENT: u32 = 1;
/// Toward area lights.
pub(super) const AREA: u32 = 2;

impl Wave {
    /// Lists the samples that the vertices at `depth` take of a technique, and says how many there are.
    fn set_tasks(&mut self, technique: Technique, depth: u32) -> usize {
        if depth > 0 {
            return self.vertices.len();
        }
        self.tasks.clear();
        for vertex in 0..self.vertices.len() as u32 {
            let slot = &self.slots[self.vertices.slot[vertex as usize] as usize];
            match technique {
                Technique::Light => {
                    let all = slot.first_light..slot.first_light + u32::from(slot.light);
                    let place = |k| self.splits[slot.pixel as usize].map_or((k, DRAWN), |split| split.place(k));
                    self.tasks.extend(all.map(place).map(|(index, kind)| (vertex, index, kind)));
                }
                Technique::Bsdf => {
                    let all = slot.first_bsdf..slot.first_bsdf + u32::from(slot.bsdf);
                    self.tasks.extend(all.map(|k| (vertex, k, DRAWN)));
                }
            }
        }
        self.tasks.len()
    }

    /// The samples from `at` on: at the first surface those listed, elsewhere one a vertex.
    #[inline(always)]
    fn task_group(&self, transport: &Transport, at: usize, depth: u32) -> TaskGroup {
        if depth > 0 {
            return self.vertex_group(transport, at);
        }
        let tasks = &self.tasks[at..self.tasks.len().min(at + LANES)];
        let task: [(u32, u32, u32); LANES] = eight(|lane| tasks[lane.min(tasks.len() - 1)]);
        let vertex = eight(|lane| task[lane].0);
        let consecutive = tasks.windows(2).all(|t| t[1].0 == t[0].0 + 1);
        let rows = if consecutive { Rows::From(vertex[0] as usize) } else { Rows::Each(vertex) };
        let slot = load_bits(&self.vertices.slot, &rows);
        // By vertex: beyond the last task `slot` holds whatever an earlier wave left there.
        let slots = eight(|lane| &self.slots[self.vertices.slot[vertex[lane] as usize] as usize]);
        TaskGroup {
            index: U::from(eight(|lane| task[lane].1)),
            seed: load_bits(&self.vertices.seed, &rows),
            slot,
            child: U::splat(u32::MAX),
            kind: U::from(eight(|lane| task[lane].2)),
            len: tasks.len(),
            rates: [0, 1, 2].map(|t| F::from(eight(|lane| slots[lane].rates[t]))),
            rows,
        }
    }

    /// One sample at each of the vertices from `at` on.
    #[inline(always)]
    fn vertex_group(&self, transport: &Transport, at: usize) -> TaskGroup {
        let rows = Rows::From(at);
        let v = &self.vertices;
        TaskGroup {
            index: load_bits(&v.index, &rows),
            seed: load_bits(&v.seed, &rows),
            slot: load_bits(&v.slot, &rows),
            child: load_bits(&v.child, &rows),
            kind: U::splat(DRAWN),
            len: LANES.min(v.len() - at),
            rates: Counts::half(1).rates(transport.lights.environment_probability).map(F::splat),
            rows,
        }
    }
}

/// The set of dimensions of light samples at a depth (0 for the first surface).
#[inline]
fn light_set(depth: u32) -> u32 {
    1 + 2 * depth
}

/// The set of dimensions of BSDF samples at a depth.
#[inline]
fn bsdf_set(depth: u32) -> u32 {
    2 + 2 * depth
}

/// A direct contribution `found` = g/(a_l p_l + a_b p_b), as the balance sees it: W = Σ_c Y_c Z_c and r.
#[inline]
fn observation(found: Vec3, light_pdf: f32, bsdf_pdf: f32, alpha: f32) -> (f32, f32) {
    // With counts that add up to 2N: Z = 2 · found, Y = Z · p_α/p_½; in ratios, so that no pdf overflows.
    let sum = light_pdf + bsdf_pdf;
    let (q_l, q_b) = (light_pdf / sum, bsdf_pdf / sum);
    let y_over_z = 2.0 * (alpha * q_l + (1.0 - alpha) * q_b);
    (4.0 * found.length_squared() * y_over_z, q_l - q_b)
}

/// [`observation`], of eight.
#[inline(always)]
fn observations(found: V3, light_pdf: F, bsdf_pdf: F, alpha: F) -> (F, F) {
    let sum = light_pdf + bsdf_pdf;
    let (q_l, q_b) = (light_pdf / sum, bsdf_pdf / sum);
    let y_over_z = F::splat(2.0) * alpha.mul_add(q_l, (F::ONE - alpha) * q_b);
    (F::splat(4.0) * found.length_squared() * y_over_z, q_l - q_b)
}
