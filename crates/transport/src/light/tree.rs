//! Which of many emissive triangles to sample, as seen from a point: a binary tree of bounds in space and direction,
//! descended by importance (Conty Estevez and Kulla 2018, *Importance Sampling of Many Lights with Adaptive Tree
//! Splitting*), with the exact probability of every choice.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::Vec3;

use super::learned::{LearnedLights, Walk, mixed};
use crate::lanes::{F, LANES, V3, eight};

/// What the tree needs to know of a triangle.
#[derive(Debug, Clone, Copy)]
pub struct Emitter {
    /// Bounding box.
    pub low: Vec3,
    /// Bounding box.
    pub high: Vec3,
    /// Unit normal of the side that shines; either where both do.
    pub normal: Vec3,
    /// How far from it, in radians, the normal may be: 0 where nothing moves.
    pub spread: f32,
    /// Luminous power, > 0.
    pub power: f32,
    /// Shines from both sides.
    pub two_sided: bool,
}

/// A cluster of emitters, as numbers that can be loaded into lanes.
#[derive(Debug, Clone, Copy, Default)]
struct Bounds {
    /// Centre of the box (3), its radius, axis of the cone of normals (3), power, negative where both sides shine.
    row: [f32; LANES],
    /// Cosine and sine of the cone's half angle, one over the radius squared.
    more: [f32; 3],
}

/// An inner node's or leaf's place in the tree.
#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// The first of two adjacent children; 0 for a leaf.
    children: u32,
    /// The emitter, of a leaf.
    emitter: u32,
    /// The node above; the root is its own.
    parent: u32,
}

/// The tree. Nodes come after their parents, and the more powerful ones first, so that the first of them are the most telling top.
#[derive(Debug)]
pub struct LightTree {
    nodes: Vec<Node>,
    /// The leaf of each emitter; `u32::MAX` for those without power.
    leaves: Vec<u32>,
}

/// A set of emitters while the tree is built.
#[derive(Debug, Clone, Copy)]
struct Cluster {
    low: Vec3,
    high: Vec3,
    axis: Vec3,
    /// Half angle of the cone of normals.
    angle: f32,
    two_sided: bool,
    power: f32,
}

/// Places to split at along each axis.
const BINS: usize = 12;

impl Cluster {
    fn of(e: &Emitter) -> Self {
        Self { low: e.low, high: e.high, axis: e.normal, angle: e.spread, two_sided: e.two_sided, power: e.power }
    }

    fn union(a: Self, b: Self) -> Self {
        let (axis, angle) = cone_union((a.axis, a.angle), (b.axis, b.angle));
        Self {
            low: a.low.min(b.low),
            high: a.high.max(b.high),
            axis,
            angle,
            two_sided: a.two_sided || b.two_sided,
            power: a.power + b.power,
        }
    }

    /// Surface area orientation heuristic: power times the measures of box and cone.
    fn cost(&self) -> f32 {
        use std::f32::consts::PI;
        let d = self.high - self.low;
        let area = 2.0 * (d.x * d.y + d.y * d.z + d.z * d.x);
        let angle = if self.two_sided { PI } else { self.angle };
        let wide = (angle + 0.5 * PI).min(PI);
        let (sin, cos) = angle.sin_cos();
        let directions = 2.0 * PI * (1.0 - cos)
            + 0.5 * PI * (2.0 * wide * sin - (angle - 2.0 * wide).cos() - 2.0 * angle * sin + cos);
        self.power * area * directions
    }

    fn bounds(&self) -> Bounds {
        let (center, half) = (0.5 * (self.low + self.high), 0.5 * (self.high - self.low));
        let (c, a) = (center, self.axis);
        let (sin, cos) = self.angle.sin_cos();
        Bounds {
            row: [c.x, c.y, c.z, half.length(), a.x, a.y, a.z, if self.two_sided { -self.power } else { self.power }],
            more: [cos, sin, 1.0 / half.length_squared().max(f32::MIN_POSITIVE)],
        }
    }
}

/// The smallest cone around two.
fn cone_union((a, angle_a): (Vec3, f32), (b, angle_b): (Vec3, f32)) -> (Vec3, f32) {
    let between = a.dot(b).clamp(-1.0, 1.0).acos();
    if (between + angle_b).min(std::f32::consts::PI) <= angle_a {
        return (a, angle_a);
    }
    if (between + angle_a).min(std::f32::consts::PI) <= angle_b {
        return (b, angle_b);
    }
    let angle = 0.5 * (angle_a + between + angle_b);
    let around = a.cross(b);
    if angle >= std::f32::consts::PI || around.length_squared() <= 1e-12 {
        return (a, std::f32::consts::PI);
    }
    let axis = glam::Quat::from_axis_angle(around.normalize(), angle - angle_a) * a;
    // A little wider, for rounding.
    (axis.normalize(), (angle + 1e-3).min(std::f32::consts::PI))
}

impl LightTree {
    /// Builds the tree; emitters without power are never chosen. `None` when none has any.
    pub fn new(emitters: &[Emitter]) -> Option<Self> {
        let mut shining: Vec<u32> = (0..emitters.len() as u32).filter(|&i| emitters[i as usize].power > 0.0).collect();
        if shining.is_empty() {
            return None;
        }
        let mut tree = Self { nodes: Vec::with_capacity(2 * shining.len()), leaves: vec![u32::MAX; emitters.len()] };
        let empty = Node { bounds: Bounds::default(), children: 0, emitter: 0, parent: 0 };
        tree.nodes.push(empty);
        // Ranges of `shining` that wait for their node to be filled, by power: of numbers >= 0 the bits are in order, too.
        let mut open = BinaryHeap::from([(0, Reverse(0), 0, shining.len())]);
        while let Some((_, Reverse(node), from, to)) = open.pop() {
            let range = &mut shining[from..to];
            let clusters = range.iter().map(|&i| Cluster::of(&emitters[i as usize]));
            let Some(whole) = clusters.reduce(Cluster::union) else { continue };
            tree.nodes[node].bounds = whole.bounds();
            if let [only] = *range {
                tree.nodes[node].emitter = only;
                tree.leaves[only as usize] = node as u32;
                continue;
            }
            let middle = from + split(emitters, range);
            let children = tree.nodes.len();
            tree.nodes[node].children = children as u32;
            tree.nodes.extend([Node { parent: node as u32, ..empty }; 2]);
            for (child, from, to) in [(children, from, middle), (children + 1, middle, to)] {
                let power: f32 = shining[from..to].iter().map(|&i| emitters[i as usize].power).sum();
                open.push((power.to_bits(), Reverse(child), from, to));
            }
        }
        Some(tree)
    }

    /// Total power.
    pub fn power(&self) -> f32 {
        self.nodes[0].bounds.row[7].abs()
    }

    /// How many of the first nodes, at most `most` and at least one, have either both children among them or none.
    pub fn top(&self, most: usize) -> usize {
        (self.nodes.len().min(most.max(1)) - 1) / 2 * 2 + 1
    }

    /// The node above; the root, 0, is its own.
    pub fn parent(&self, node: usize) -> usize {
        self.nodes[node].parent as usize
    }

    /// The lowest of the first `top` nodes that has `emitter` below it, or is it; `None` of one without power.
    pub fn above(&self, emitter: u32, top: usize) -> Option<usize> {
        let up = |&node: &usize| Some(self.parent(node));
        let leaf = Some(self.leaves[emitter as usize] as usize).filter(|&leaf| leaf < self.nodes.len());
        std::iter::successors(leaf, up).find(|&node| node < top)
    }

    /// Chooses an emitter for each of eight points `p` with unit geometric normals `n`, zero where light from both sides
    /// counts, by `u` in [0, 1): the emitters and the probabilities of choosing them, 0 where none can shine at the point's side.
    /// What is `learned` of the lights has its say.
    #[inline]
    pub fn sample(&self, p: V3, n: V3, u: F, learned: Option<&LearnedLights>) -> ([u32; LANES], F) {
        match learned {
            None => self.descend(p, n, u, None),
            Some(lights) => self.descend(p, n, u, Some(lights.from(p, n))),
        }
    }

    #[inline(always)]
    fn descend(&self, p: V3, n: V3, mut u: F, mut walk: Option<Walk>) -> ([u32; LANES], F) {
        let mut at = [0u32; LANES];
        let mut pmf = F::ONE;
        loop {
            let first = eight(|lane| self.nodes[at[lane] as usize].children);
            if first.iter().all(|&f| f == 0) {
                break;
            }
            // Lanes that have arrived stay with what they have: both "children" of a leaf are the leaf.
            let inner = F::from(eight(|lane| first[lane] as f32)).simd_gt(F::ZERO);
            let mut left = [0; LANES];
            let mut right = [0; LANES];
            for lane in 0..LANES {
                let moving = u32::from(first[lane] != 0);
                left[lane] = if moving == 1 { first[lane] } else { at[lane] };
                right[lane] = left[lane] + moving;
            }
            let a = self.importance(left, p, n);
            let b = self.importance(right, p, n);
            let of_tree = a / (a + b);
            let share = match &walk {
                Some(walk) if walk.knows(left) => walk.share(left, right, [a, b], of_tree),
                _ => of_tree,
            };
            let goes_left = u.simd_lt(share);
            let chance = goes_left.select(share, F::ONE - share);
            let rest = goes_left.select(u, u - share) / chance;
            let below_one = F::splat(crate::sampling::warp::ONE_MINUS);
            u = inner.select(rest.fast_max(F::ZERO).fast_min(below_one), u);
            pmf = inner.select(pmf * chance, pmf);
            if let Some(walk) = walk.as_mut().filter(|walk| walk.knows(left)) {
                walk.went(goes_left.select(of_tree, F::ONE - of_tree), chance);
            }
            let goes_left = goes_left.to_bitmask();
            for lane in 0..LANES {
                at[lane] = if goes_left >> lane & 1 == 1 { left[lane] } else { right[lane] };
            }
        }
        // 0/0 on the way: nothing shines here.
        (eight(|lane| self.nodes[at[lane] as usize].emitter), pmf & pmf.simd_ge(F::ZERO))
    }

    /// The probabilities with which [`sample`](Self::sample) chooses `emitter` for point `p` with normal `n`, zero as there: by the
    /// tree alone, and with what is `learned`.
    #[inline]
    pub fn pmfs(&self, p: Vec3, n: Vec3, emitter: u32, learned: Option<&LearnedLights>) -> [f32; 2] {
        let mut at = self.leaves[emitter as usize];
        if at == u32::MAX {
            return [0.0; 2];
        }
        let (p, n) = (V3::splat(p), V3::splat(n));
        let lights = learned.map(|lights| lights.from(p, n));
        let (mut by_tree, mut led) = (1.0, 1.0);
        while at != 0 {
            let parent = self.nodes[at as usize].parent;
            let first = self.nodes[parent as usize].children;
            let mut both = [first; LANES];
            both[1] = first + 1;
            let importance = self.importance(both, p, n);
            let share_of = |importance: F| {
                let [left, right, ..] = importance.to_array();
                if at == first { left / (left + right) } else { right / (left + right) }
            };
            let share = share_of(importance);
            if share <= 0.0 || share.is_nan() {
                return [0.0; 2];
            }
            by_tree *= share;
            led *= lights.as_ref().map_or(share, |lights| share_of(importance * lights.weights(both)));
            at = parent;
        }
        [by_tree, if learned.is_some() { mixed(by_tree, led) } else { by_tree }]
    }

    /// How much of a node's power may arrive at `p` and leave toward the eye, up to a common factor: never zero where
    /// some does.
    #[inline(always)]
    fn importance(&self, node: [u32; LANES], p: V3, n: V3) -> F {
        let bounds = eight(|lane| &self.nodes[node[lane] as usize].bounds);
        let [cx, cy, cz, radius, ax, ay, az, power] = F::transpose(eight(|lane| F::from(bounds[lane].row)));
        let more = |k: usize| F::from(eight(|lane| bounds[lane].more[k]));
        let (cos_o, sin_o, one_over_radius2) = (more(0), more(1), more(2));
        let to = V3 { x: cx, y: cy, z: cz } - p;
        let distance2 = to.length_squared();
        let one_over_distance = F::ONE / distance2.sqrt();
        let wi = to * one_over_distance;
        // Half angle under which the bounding sphere is seen.
        let sin_b = radius * one_over_distance;
        let inside = !sin_b.simd_lt(F::ONE);
        let cos_b = (F::ONE - sin_b * sin_b).fast_max(F::ZERO).sqrt();
        let (sin_b, cos_b) = (inside.select(F::ZERO, sin_b), inside.select(-F::ONE, cos_b));
        // Angle between the light's normals and the way to the point, at least.
        let cos = -(V3 { x: ax, y: ay, z: az }).dot(wi);
        let cos = power.simd_lt(F::ZERO).select(cos.abs(), cos);
        let (cos, sin) = cos_minus(cos, sin_of(cos), cos_o, sin_o);
        let (cos, _) = cos_minus(cos, sin, cos_b, sin_b);
        // Angle at the receiver, at least; any where light passes through it.
        let cos_i = n.dot(wi);
        let (cos_i, _) = cos_minus(cos_i, sin_of(cos_i), cos_b, sin_b);
        let cos_i = n.length_squared().simd_gt(F::ZERO).select(cos_i, F::ONE);
        let importance = power.abs() * cos.fast_max(F::ZERO) * cos_i.fast_max(F::ZERO);
        importance * inside.select(one_over_radius2, one_over_distance * one_over_distance)
    }
}

#[inline(always)]
fn sin_of(cos: F) -> F {
    (F::ONE - cos * cos).fast_max(F::ZERO).sqrt()
}

/// Cosine and sine of angle a less angle b, or of 0 where b is larger.
#[inline(always)]
fn cos_minus(cos_a: F, sin_a: F, cos_b: F, sin_b: F) -> (F, F) {
    let covered = cos_a.simd_gt(cos_b);
    let cos = cos_a.mul_add(cos_b, sin_a * sin_b);
    let sin = sin_a.mul_sub(cos_b, cos_a * sin_b);
    (covered.select(F::ONE, cos), covered.select(F::ZERO, sin))
}

/// Sorts emitters into two halves, neither empty, and returns where the second begins.
fn split(emitters: &[Emitter], range: &mut [u32]) -> usize {
    let center = |i: u32| 0.5 * (emitters[i as usize].low + emitters[i as usize].high);
    let low = range.iter().map(|&i| center(i)).reduce(Vec3::min).unwrap_or_default();
    let high = range.iter().map(|&i| center(i)).reduce(Vec3::max).unwrap_or_default();
    let bin_of = |i: u32, axis: usize| {
        let t = (center(i)[axis] - low[axis]) / (high[axis] - low[axis]);
        ((t * BINS as f32) as usize).min(BINS - 1)
    };
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| high[axis] > low[axis]) {
        let mut bins = [None; BINS];
        for &i in range.iter() {
            let own = Cluster::of(&emitters[i as usize]);
            let bin = &mut bins[bin_of(i, axis)];
            *bin = Some(bin.map_or(own, |b| Cluster::union(b, own)));
        }
        let join = |bins: &[Option<Cluster>]| bins.iter().flatten().copied().reduce(Cluster::union);
        for at in 1..BINS {
            if let (Some(a), Some(b)) = (join(&bins[..at]), join(&bins[at..])) {
                let cost = a.cost() + b.cost();
                if best.is_none_or(|(lowest, ..)| cost < lowest) {
                    best = Some((cost, axis, at));
                }
            }
        }
    }
    match best {
        Some((_, axis, at)) => {
            range.sort_by_key(|&i| bin_of(i, axis) >= at);
            range.partition_point(|&i| bin_of(i, axis) < at)
        }
        // All in one place.
        None => range.len() / 2,
    }
}

#[cfg(test)]
mod tests;
