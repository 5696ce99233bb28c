//! The light tree: a binary tree of bounds in space and direction over emissive triangles. A light is chosen for a point by
//! descent by importance (Conty Estevez and Kulla 2018, *Importance Sampling of Many Lights with Adaptive Tree Splitting*),
//! with the exact probability of every choice.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::Vec3;

use super::learned::{Descent, LearnedLights, mixture};
use crate::lanes::{F, LANES, V3, eight};

/// The properties of an emissive triangle or parallelogram by which the tree chooses.
#[derive(Debug, Clone, Copy)]
pub struct Emitter {
    /// Lower corner of the bounding box, world space.
    pub low: Vec3,
    /// Upper corner of the bounding box.
    pub high: Vec3,
    /// Unit normal of the emitting side; of either where both emit.
    pub normal: Vec3,
    /// Largest angle in radians between `normal` and the true normal while the shutter is open; 0 for static lights.
    pub spread: f32,
    /// Luminance of the emitted power; 0 for emitters that are never chosen.
    pub power: f32,
    pub two_sided: bool,
}

/// The bounds of a cluster of emitters, laid out to be loaded into lanes.
#[derive(Debug, Clone, Copy, Default)]
struct Bounds {
    /// Centre of the box (3), its radius, axis of the cone of normals (3), power, which is negative where both sides emit.
    row: [f32; LANES],
    /// Cosine and sine of the cone's half angle, one over the squared radius.
    cone: [f32; 3],
}

impl Bounds {
    /// Luminance of the emitted power.
    fn power(&self) -> f32 {
        self.row[7].abs()
    }
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// Index of the first of two adjacent children; 0 for a leaf.
    children: u32,
    /// The emitter of a leaf.
    emitter: u32,
    /// Index of the parent; the root is its own.
    parent: u32,
}

/// A light tree. Nodes come after their parents, in the order of power, so that the first nodes form the most important cut.
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

/// Number of bins along each axis when a cluster is split.
const BINS: usize = 12;

impl Cluster {
    fn new(e: &Emitter) -> Self {
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

    /// Surface area orientation heuristic: power times the measures of the box and the cone.
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
            cone: [cos, sin, 1.0 / half.length_squared().max(f32::MIN_POSITIVE)],
        }
    }
}

/// The smallest cone that contains two cones, given by axis and half angle.
fn cone_union((a, angle_a): (Vec3, f32), (b, angle_b): (Vec3, f32)) -> (Vec3, f32) {
    // What the first condition below says of a cone of all directions.
    if angle_a >= std::f32::consts::PI {
        return (a, angle_a);
    }
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
    /// Builds the tree. Emitters without power are never chosen. `None` if no emitter has power.
    pub fn new(emitters: &[Emitter]) -> Option<Self> {
        let mut shining: Vec<u32> = (0..emitters.len() as u32).filter(|&i| emitters[i as usize].power > 0.0).collect();
        if shining.is_empty() {
            return None;
        }
        let empty = Node { bounds: Bounds::default(), children: 0, emitter: 0, parent: 0 };
        let mut nodes = vec![empty; 2 * shining.len() - 1];
        grow(emitters, &mut shining, &mut nodes, 0);
        let mut tree = Self { nodes, leaves: vec![u32::MAX; emitters.len()] };
        tree.sort();
        Some(tree)
    }

    /// Brings the nodes of [`grow`] into the order of power, and links them.
    fn sort(&mut self) {
        let mut place = vec![0_u32; self.nodes.len()];
        let mut next = 1;
        // Nodes whose place is known, by power: the bits of numbers >= 0 have the order of the numbers.
        let mut open = BinaryHeap::from([(0, Reverse(0), 0)]);
        while let Some((_, Reverse(to), from)) = open.pop() {
            place[from] = to;
            let left_emitters = self.nodes[from].children as usize;
            if left_emitters == 0 {
                self.leaves[self.nodes[from].emitter as usize] = to;
                continue;
            }
            self.nodes[from].children = next;
            for child in children(from, left_emitters) {
                self.nodes[child].parent = to;
                open.push((self.nodes[child].bounds.power().to_bits(), Reverse(next), child));
                next += 1;
            }
        }
        for at in 0..place.len() {
            while place[at] as usize != at {
                let to = place[at] as usize;
                self.nodes.swap(at, to);
                place.swap(at, to);
            }
        }
    }

    /// Luminance of the total emitted power.
    pub fn power(&self) -> f32 {
        self.nodes[0].bounds.power()
    }

    /// The number of first nodes, at most `max` and at least one, that form a cut: each has both children among them or none.
    pub fn top(&self, max: usize) -> usize {
        (self.nodes.len().min(max.max(1)) - 1) / 2 * 2 + 1
    }

    /// Index of the parent; the root, 0, is its own.
    pub fn parent(&self, node: usize) -> usize {
        self.nodes[node].parent as usize
    }

    /// The lowest of the first `top` nodes that contains `emitter`; `None` for an emitter without power.
    pub fn above(&self, emitter: u32, top: usize) -> Option<usize> {
        let up = |&node: &usize| Some(self.parent(node));
        let leaf = Some(self.leaves[emitter as usize] as usize).filter(|&leaf| leaf < self.nodes.len());
        std::iter::successors(leaf, up).find(|&node| node < top)
    }

    /// Chooses an emitter for each of eight points `p` by `u` in [0, 1): the emitters, and the probabilities of their choice, 0
    /// where none can illuminate the point's side. The unit geometric normal `n` is zero where light from both sides counts.
    /// `learned` weights modify the choice.
    #[inline]
    pub fn sample(&self, p: V3, n: V3, u: F, learned: Option<&LearnedLights>) -> ([u32; LANES], F) {
        match learned {
            None => self.descend(p, n, u, None),
            Some(lights) => self.descend(p, n, u, Some(lights.from(p, n))),
        }
    }

    #[inline(always)]
    fn descend(&self, p: V3, n: V3, mut u: F, mut learned: Option<Descent>) -> ([u32; LANES], F) {
        let mut at = [0u32; LANES];
        let mut pmf = F::ONE;
        loop {
            let first = eight(|lane| self.nodes[at[lane] as usize].children);
            if first.iter().all(|&f| f == 0) {
                break;
            }
            // Lanes at a leaf stay there: both "children" of a leaf are the leaf.
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
            let by_tree = a / (a + b);
            let p_left = match &learned {
                Some(learned) if learned.has_weights(left) => learned.left_probability(left, right, [a, b], by_tree),
                _ => by_tree,
            };
            let goes_left = u.simd_lt(p_left);
            let probability = goes_left.select(p_left, F::ONE - p_left);
            let rest = goes_left.select(u, u - p_left) / probability;
            let below_one = F::splat(crate::sampling::warp::ONE_MINUS_EPSILON);
            u = inner.select(rest.fast_max(F::ZERO).fast_min(below_one), u);
            pmf = inner.select(pmf * probability, pmf);
            if let Some(learned) = learned.as_mut().filter(|learned| learned.has_weights(left)) {
                learned.descend(goes_left.select(by_tree, F::ONE - by_tree), probability);
            }
            let goes_left = goes_left.to_bitmask();
            for lane in 0..LANES {
                at[lane] = if goes_left >> lane & 1 == 1 { left[lane] } else { right[lane] };
            }
        }
        // A NaN comes from 0/0 during the descent: no light reaches this point.
        (eight(|lane| self.nodes[at[lane] as usize].emitter), pmf & pmf.simd_ge(F::ZERO))
    }

    /// The probabilities with which [`sample`](Self::sample) chooses `emitter` for point `p` with normal `n`: by the tree alone,
    /// and with the `learned` weights.
    #[inline]
    pub fn pmfs(&self, p: Vec3, n: Vec3, emitter: u32, learned: Option<&LearnedLights>) -> [f32; 2] {
        let mut at = self.leaves[emitter as usize];
        if at == u32::MAX {
            return [0.0; 2];
        }
        let (p, n) = (V3::splat(p), V3::splat(n));
        let lights = learned.map(|lights| lights.from(p, n));
        let (mut by_tree, mut by_weights) = (1.0, 1.0);
        while at != 0 {
            let parent = self.nodes[at as usize].parent;
            let first = self.nodes[parent as usize].children;
            let mut both = [first; LANES];
            both[1] = first + 1;
            let importance = self.importance(both, p, n);
            let probability = |importance: F| {
                let [left, right, ..] = importance.to_array();
                if at == first { left / (left + right) } else { right / (left + right) }
            };
            let own = probability(importance);
            if own <= 0.0 || own.is_nan() {
                return [0.0; 2];
            }
            by_tree *= own;
            by_weights *= lights.as_ref().map_or(own, |lights| probability(importance * lights.weights(both)));
            at = parent;
        }
        [by_tree, if learned.is_some() { mixture(by_tree, by_weights) } else { by_tree }]
    }

    /// An upper bound of the radiance that a node's lights cause at `p`, up to a common factor; zero only if they cause none.
    #[inline(always)]
    fn importance(&self, node: [u32; LANES], p: V3, n: V3) -> F {
        let bounds = eight(|lane| &self.nodes[node[lane] as usize].bounds);
        let [cx, cy, cz, radius, ax, ay, az, power] = F::transpose(eight(|lane| F::from(bounds[lane].row)));
        let cone = |k: usize| F::from(eight(|lane| bounds[lane].cone[k]));
        let (cos_o, sin_o, one_over_radius2) = (cone(0), cone(1), cone(2));
        let to = V3 { x: cx, y: cy, z: cz } - p;
        let distance2 = to.length_squared();
        let one_over_distance = F::ONE / distance2.sqrt();
        let wi = to * one_over_distance;
        // Half angle that the bounding sphere subtends.
        let sin_b = radius * one_over_distance;
        let inside = !sin_b.simd_lt(F::ONE);
        let cos_b = (F::ONE - sin_b * sin_b).fast_max(F::ZERO).sqrt();
        let (sin_b, cos_b) = (inside.select(F::ZERO, sin_b), inside.select(-F::ONE, cos_b));
        // Smallest angle between the lights' normals and the direction to the point.
        let cos = -(V3 { x: ax, y: ay, z: az }).dot(wi);
        let cos = power.simd_lt(F::ZERO).select(cos.abs(), cos);
        let (cos, sin) = cos_minus(cos, sin_of(cos), cos_o, sin_o);
        let (cos, _) = cos_minus(cos, sin, cos_b, sin_b);
        // Smallest angle at the receiver; 0 where light from both sides counts.
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

/// Cosine and sine of angle a minus angle b, or of 0 where b is larger.
#[inline(always)]
fn cos_minus(cos_a: F, sin_a: F, cos_b: F, sin_b: F) -> (F, F) {
    let covered = cos_a.simd_gt(cos_b);
    let cos = cos_a.mul_add(cos_b, sin_a * sin_b);
    let sin = sin_a.mul_sub(cos_b, cos_a * sin_b);
    (covered.select(F::ONE, cos), covered.select(F::ZERO, sin))
}

/// Number of times that the building of the tree is divided among threads, and the fewest emitters of which a part is divided.
const FORKS: usize = 6;
const MIN_FORK: usize = 4096;

/// The children of node `at` while the tree is built: a node is followed by its left child with all its descendants, and they by
/// its right child.
fn children(at: usize, left_emitters: usize) -> [usize; 2] {
    [at + 1, at + 2 * left_emitters]
}

/// Builds the nodes of a set of emitters, twice as many less one, in the order of [`children`]. `children` of a node is the
/// number of its left child's emitters, 0 for a leaf.
fn grow(emitters: &[Emitter], range: &mut [u32], nodes: &mut [Node], forks: usize) {
    if forks < FORKS && range.len() >= MIN_FORK {
        let left_emitters = divide(emitters, range, &mut nodes[0]);
        let (left, right) = range.split_at_mut(left_emitters);
        let (left_nodes, right_nodes) = nodes[1..].split_at_mut(2 * left_emitters - 1);
        rayon::join(|| grow(emitters, left, left_nodes, forks + 1), || grow(emitters, right, right_nodes, forks + 1));
        return;
    }
    // Not by recursion, whose depth emitters of very different distances would make large.
    let mut open = vec![(0, range.len(), 0)];
    while let Some((from, to, at)) = open.pop() {
        let left_emitters = divide(emitters, &mut range[from..to], &mut nodes[at]);
        if left_emitters > 0 {
            let ([left, right], middle) = (children(at, left_emitters), from + left_emitters);
            open.extend([(from, middle, left), (middle, to, right)]);
        }
    }
}

/// Makes the node of a set of emitters, and partitions them; returns the number of those of the left child, 0 for a leaf.
fn divide(emitters: &[Emitter], range: &mut [u32], node: &mut Node) -> usize {
    let clusters = range.iter().map(|&i| Cluster::new(&emitters[i as usize]));
    let Some(whole) = clusters.reduce(Cluster::union) else { return 0 };
    node.bounds = whole.bounds();
    if let [only] = *range {
        node.emitter = only;
        return 0;
    }
    let left_emitters = split(emitters, range);
    node.children = left_emitters as u32;
    left_emitters
}

/// Partitions emitters into two parts, neither empty, and returns the index of the second one's start.
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
            let own = Cluster::new(&emitters[i as usize]);
            let bin = &mut bins[bin_of(i, axis)];
            *bin = Some(bin.map_or(own, |b| Cluster::union(b, own)));
        }
        let mut before: Option<Cluster> = None;
        for at in 1..BINS {
            // After an empty bin, both parts are those of the step before.
            let Some(bin) = bins[at - 1] else { continue };
            let a = before.map_or(bin, |before| Cluster::union(before, bin));
            before = Some(a);
            if let Some(b) = bins[at..].iter().flatten().copied().reduce(Cluster::union) {
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
        // All have the same centre.
        None => range.len() / 2,
    }
}

#[cfg(test)]
mod tests;
