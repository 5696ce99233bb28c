//! Vertex data of a mesh while it is built.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::scene::import::report::Notes;
use crate::scene::{Mesh, Positions};

/// A mesh while it is built.
#[derive(Debug, Default)]
pub struct Geometry {
    /// All its arrays of vertex data are as long as `positions`.
    pub mesh: Mesh,
    /// Index of each vertex in the file; present if other time samples are needed.
    pub source: Option<Vec<u32>>,
    /// Numbers that were not finite and had no effect: weights of joints, deltas of morph targets.
    pub mended: usize,
    /// Texture coordinate sets for which tangents must still be made, of the mesh and of its coat.
    pub tangents_for: [Option<u8>; 2],
}

fn point(g: &Geometry, i: u32) -> DVec3 {
    DVec3::from(g.mesh.positions[i as usize].map(f64::from))
}

/// Twice the triangle's area vector.
pub fn cross(g: &Geometry, [a, b, c]: [u32; 3]) -> DVec3 {
    (point(g, b) - point(g, a)).cross(point(g, c) - point(g, a))
}

impl Geometry {
    /// Replaces colours and texture coordinates that are NaN or infinite, with a note: NaN in a colour by 1, in coordinates by 0.
    /// Colours are clamped to [0, 1]; normals and tangents are made unit vectors later.
    pub(crate) fn mend_numbers(&mut self, at: &str, notes: &mut Notes) {
        let (mesh, mut mended) = (&mut self.mesh, self.mended);
        let mut mend = |x: &mut f32, instead: f32| {
            if !x.is_finite() {
                *x = if x.is_nan() { instead } else { x.clamp(0.0, 1.0) };
                mended += 1;
            }
        };
        mesh.colors.iter_mut().flatten().flatten().for_each(|x| mend(x, 1.0));
        let sets = mesh.texcoords.iter_mut().flatten().chain(mesh.more_texcoords.iter_mut().map(|(_, set)| set));
        sets.flatten().flatten().for_each(|x| mend(x, 0.0));
        mesh.tangents.iter_mut().flatten().filter(|t| !t.iter().all(|x| x.is_finite())).for_each(|t| {
            *t = [0.0, 0.0, 0.0, if t[3] < 0.0 { -1.0 } else { 1.0 }];
            mended += 1;
        });
        if mended > 0 {
            notes.repaired(
                at,
                format!("{mended} numbers of colours, tangents, texture coordinates, weights or morph targets are not finite: replaced"),
            );
        }
    }

    /// Removes triangles of which a corner is not finite, here or at one of the `others`' times, with a note.
    pub(crate) fn drop_not_finite<'a>(&mut self, others: impl Iterator<Item = &'a Self>, at: &str, notes: &mut Notes) {
        let not_finite = |g: &Self, i: usize| !g.mesh.positions[i].iter().all(|x| x.is_finite());
        let mut bad: Vec<bool> = (0..self.mesh.positions.len()).map(|i| not_finite(self, i)).collect();
        others.for_each(|g| bad.iter_mut().enumerate().for_each(|(i, bad)| *bad |= not_finite(g, i)));
        let before = self.mesh.indices.len();
        self.mesh.indices.retain(|t| !t.iter().any(|&i| bad[i as usize]));
        let dropped = before - self.mesh.indices.len();
        if dropped > 0 {
            notes.not_loaded(at, format!("{dropped} triangles with a position that is not finite"));
        }
    }

    /// Removes triangles that are lines as seen along a direction.
    pub(crate) fn drop_edge_on(&mut self, direction: DVec3) {
        let mut indices = std::mem::take(&mut self.mesh.indices);
        indices.retain(|&t| cross(self, t).normalize_or_zero().dot(direction).abs() > 1e-9);
        self.mesh.indices = indices;
    }

    /// Removes triangles of whose vertices none has an alpha that `shows`, with a note.
    pub(crate) fn drop_clear(&mut self, shows: impl Fn(f32) -> bool, at: &str, notes: &mut Notes) {
        let before = self.mesh.indices.len();
        let colors = self.mesh.colors.as_ref();
        let alpha = |t: &[u32; 3]| colors.map_or(1.0, |c| t.iter().map(|&i| c[i as usize][3]).fold(0.0, f32::max));
        self.mesh.indices.retain(|t| shows(alpha(t)));
        if self.mesh.indices.len() < before {
            notes.not_loaded(at, "triangles that nothing can see: their alpha is 0, or below the cutoff");
        }
    }

    pub(crate) fn drop_degenerate(&mut self, at: &str, notes: &mut Notes) {
        let before = self.mesh.indices.len();
        let mut indices = std::mem::take(&mut self.mesh.indices);
        indices.retain(|&t| cross(self, t) != DVec3::ZERO);
        self.mesh.indices = indices;
        if self.mesh.indices.len() < before {
            notes.not_loaded(at, "triangles without area");
        }
    }

    /// Removes vertices that no triangle uses: primitives often share one large array.
    pub fn compact(&mut self) {
        let mut used = vec![false; self.mesh.positions.len()];
        self.mesh.indices.iter().flatten().for_each(|&i| used[i as usize] = true);
        if !used.contains(&false) {
            return;
        }
        let kept: Vec<u32> = (0..).zip(&used).filter(|(_, used)| **used).map(|(i, _)| i).collect();
        let mut new_index = vec![0; used.len()];
        (0..).zip(&kept).for_each(|(next, &i)| new_index[i as usize] = next);
        self.mesh.indices.iter_mut().flatten().for_each(|i| *i = new_index[*i as usize]);
        self.pick(&kept);
    }

    /// Replaces the vertices by those with these indices.
    fn pick(&mut self, from: &[u32]) {
        fn pick<T: Copy>(values: &mut Vec<T>, from: &[u32]) {
            *values = from.iter().map(|&i| values[i as usize]).collect();
        }
        self.mesh.positions = Positions::new(from.iter().map(|&i| self.mesh.positions[i as usize]).collect());
        self.source.iter_mut().for_each(|v| pick(v, from));
        self.mesh.normals.iter_mut().for_each(|v| pick(v, from));
        let mesh = &mut self.mesh;
        [&mut mesh.tangents, &mut mesh.coat_tangents].into_iter().flatten().for_each(|v| pick(v, from));
        self.mesh.texcoords.iter_mut().flatten().for_each(|v| pick(v, from));
        self.mesh.more_texcoords.iter_mut().for_each(|(_, v)| pick(v, from));
        self.mesh.colors.iter_mut().for_each(|v| pick(v, from));
    }

    /// Normalizes normals; those of length zero become the area-weighted mean of their triangles' normals. Normals that contradict
    /// the winding of all triangles are negated; returns whether they were.
    pub(crate) fn repair_normals(&mut self, at: &str, notes: &mut Notes) -> bool {
        let Some(mut normals) = self.mesh.normals.take() else { return false };
        let mut missing = false;
        for n in &mut normals {
            let unit = Vec3::from(*n).as_dvec3().try_normalize();
            missing |= unit.is_none();
            *n = unit.unwrap_or(DVec3::ZERO).as_vec3().to_array();
        }
        if missing {
            notes.repaired(at, "normals of length 0, or not finite: the triangles' own are used");
            let mut sums = vec![DVec3::ZERO; normals.len()];
            for &t in &self.mesh.indices {
                let area = cross(self, t);
                t.iter().for_each(|&i| sums[i as usize] += area);
            }
            for (n, sum) in normals.iter_mut().zip(sums).filter(|(n, _)| **n == [0.0; 3]) {
                *n = sum.try_normalize().unwrap_or(DVec3::Y).as_vec3().to_array();
            }
        }
        // The specification takes the front from the winding. Shaded by such normals, either side would be black.
        let against = |t: &[u32; 3]| {
            let sum: DVec3 = t.iter().map(|&i| Vec3::from(normals[i as usize]).as_dvec3()).sum();
            sum.dot(cross(self, *t)) < 0.0
        };
        let is_inverted = self.mesh.indices.iter().all(against);
        if is_inverted {
            notes.repaired(at, "normals that point away from the front of every triangle: turned around");
            normals.iter_mut().flatten().for_each(|x| *x = -*x);
            // The bitangent stays as it was.
            self.mesh.tangents.iter_mut().flatten().for_each(|t| t[3] = -t[3]);
        }
        self.mesh.normals = Some(normals);
        is_inverted
    }

    /// Splits vertices so that no two triangles share one.
    pub(crate) fn unweld(&mut self) {
        let triangles = std::mem::take(&mut self.mesh.indices);
        self.pick(triangles.as_flattened());
        self.mesh.indices = (0..triangles.len() as u32).map(|i| [0, 1, 2].map(|corner| 3 * i + corner)).collect();
    }

    /// Merges the corners of an unwelded mesh whose original vertex (`origin`) and tangents are equal.
    pub(crate) fn weld(&mut self, origin: &[u32]) {
        let mut by_key: HashMap<(u32, [[u32; 4]; 2]), u32> = HashMap::new();
        let mut kept: Vec<u32> = Vec::new();
        let tangents = [&self.mesh.tangents, &self.mesh.coat_tangents];
        let mut target = Vec::with_capacity(origin.len());
        for (corner, &vertex) in (0..).zip(origin) {
            let bits = tangents.map(|t| t.as_ref().map_or([0; 4], |t| t[corner as usize].map(f32::to_bits)));
            target.push(*by_key.entry((vertex, bits)).or_insert_with(|| {
                kept.push(corner);
                (kept.len() - 1) as u32
            }));
        }
        self.pick(&kept);
        self.mesh.indices.iter_mut().flatten().for_each(|i| *i = target[*i as usize]);
    }
}
