//! What happens between two ray queries, stage by stage: what the hits emit ([`hits`]), which shadow rays follow
//! ([`lights`]), which next rays ([`scatter`]).

pub mod hits;
pub mod lights;
pub mod scatter;

use glam::Vec3;

use super::wave::Wave;
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
    /// How many count.
    len: usize,
    /// Light and BSDF samples a path.
    a_l: F,
    a_b: F,
}

impl Wave {
    /// Lists the samples that the vertices at `depth` take of a technique, and says how many there are.
    fn set_tasks(&mut self, technique: Technique, depth: u32) -> usize {
        if depth > 0 {
            return self.vertices.len();
        }
        self.tasks.clear();
        for vertex in 0..self.vertices.len() as u32 {
            let slot = &self.slots[self.vertices.slot[vertex as usize] as usize];
            let (n, first) = match technique {
                Technique::Light => (slot.light, slot.first_light),
                Technique::Bsdf => (slot.bsdf, slot.first_bsdf),
            };
            self.tasks.extend((0..u32::from(n)).map(|k| (vertex, first + k)));
        }
        self.tasks.len()
    }

    /// The samples from `at` on: at the first surface those listed, elsewhere one a vertex.
    #[inline(always)]
    fn task_group(&self, at: usize, depth: u32) -> TaskGroup {
        if depth > 0 {
            return self.vertex_group(at);
        }
        let tasks = &self.tasks[at..self.tasks.len().min(at + LANES)];
        let task: [(u32, u32); LANES] = eight(|lane| tasks[lane.min(tasks.len() - 1)]);
        let vertex = eight(|lane| task[lane].0);
        let consecutive = tasks.windows(2).all(|t| t[1].0 == t[0].0 + 1);
        let rows = if consecutive { Rows::From(vertex[0] as usize) } else { Rows::Each(vertex) };
        let slot = load_bits(&self.vertices.slot, &rows);
        let slots = eight(|lane| &self.slots[slot.as_array()[lane] as usize]);
        TaskGroup {
            index: U::from(eight(|lane| task[lane].1)),
            seed: load_bits(&self.vertices.seed, &rows),
            slot,
            child: U::splat(u32::MAX),
            len: tasks.len(),
            a_l: F::from(eight(|lane| slots[lane].a_l)),
            a_b: F::from(eight(|lane| slots[lane].a_b)),
            rows,
        }
    }

    /// One sample at each of the vertices from `at` on.
    #[inline(always)]
    fn vertex_group(&self, at: usize) -> TaskGroup {
        let rows = Rows::From(at);
        let v = &self.vertices;
        TaskGroup {
            index: load_bits(&v.index, &rows),
            seed: load_bits(&v.seed, &rows),
            slot: load_bits(&v.slot, &rows),
            child: load_bits(&v.child, &rows),
            len: LANES.min(v.len() - at),
            a_l: F::ONE,
            a_b: F::ONE,
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
