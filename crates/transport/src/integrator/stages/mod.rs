//! The stages between ray queries. Each is a function from queues to queues: camera rays; sorting of hits; absorption by
//! media; emission; vertices on scattering surfaces; sample requests; light samples (shadow rays); BSDF samples (next rays).

pub mod camera_rays;
pub mod emission;
pub mod lights;
pub mod media;
pub mod mixture;
pub mod requests;
pub mod scatter;
pub mod sort;
pub mod surfaces;

use crate::lanes::{LANES, Rows};

/// Up to eight entries of a list of row numbers from `at` on, and their number. Spare lanes repeat the first entry.
#[inline(always)]
fn eight_of(list: &[u32], at: usize) -> (Rows, usize) {
    let n = LANES.min(list.len() - at);
    let mut rows = [list[at]; LANES];
    rows[..n].copy_from_slice(&list[at..at + n]);
    let consecutive = n == LANES && rows[LANES - 1] == rows[0] + LANES as u32 - 1;
    (if consecutive { Rows::From(rows[0] as usize) } else { Rows::Each(rows) }, n)
}
