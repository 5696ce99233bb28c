//! Cells in space: a k-d tree over positions and normals. The normals keep the two sides of a thin wall apart.

use glam::Vec3;

use crate::lanes::{F, LANES, V3, eight};

/// A point of the tree's domain: position in metres, and the normal times the tree's scale.
pub type CellKey = [f32; 6];

/// The value of a node's axis that marks a leaf.
const LEAF: u32 = 7;
/// Number of bits of a node's axis.
const AXIS_BITS: u32 = 3;

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Keys below this value go to the first child. In a leaf, its bits are the number of the leaf.
    split: f32,
    /// The axis in the low bits; above them the index of the first child (the second follows it), or of the leaf's own node.
    next: u32,
}

impl Node {
    /// Leaf number `leaf`, as the node with index `node`. A descent stays there: no −∞ reaches a `split` that is not negative.
    fn leaf(node: usize, leaf: u32) -> Self {
        Self { split: f32::from_bits(leaf), next: LEAF | (node as u32) << AXIS_BITS }
    }

    /// The node that follows for a key whose value on axis i is `key(i)`; −∞ on axis [`LEAF`].
    #[inline(always)]
    fn next(self, key: impl FnOnce(usize) -> f32) -> u32 {
        (self.next >> AXIS_BITS) + u32::from(key((self.next & LEAF) as usize) >= self.split)
    }
}

/// A k-d tree over keys, whose leaves are the cells.
#[derive(Debug, Clone)]
pub struct CellTree {
    nodes: Vec<Node>,
    /// Weight of differences of normals against distances, in metres.
    scale: f32,
    leaves: u32,
}

impl CellTree {
    /// Builds a tree of at most `max_leaves` leaves, each with at most `max_keys` of `keys` if these differ. The keys are made
    /// by [`key`](Self::key) with the same `scale`.
    pub fn new(mut keys: Vec<CellKey>, scale: f32, max_keys: usize, max_leaves: usize) -> Self {
        let max_keys = max_keys.max(2 * keys.len() / max_leaves.max(1)).max(1);
        let mut tree = Self { nodes: vec![Node::leaf(0, 0)], scale, leaves: 0 };
        let mut open = vec![(0, 0..keys.len())];
        while let Some((node, range)) = open.pop() {
            let here = &mut keys[range.clone()];
            let room = tree.leaves as usize + open.len() + 2 <= max_leaves;
            let split = if here.len() > max_keys && room { split(here) } else { None };
            let Some((axis, at, middle)) = split else {
                tree.nodes[node] = Node::leaf(node, tree.leaves);
                tree.leaves += 1;
                continue;
            };
            let first = tree.nodes.len();
            tree.nodes[node] = Node { split: at, next: axis as u32 | (first as u32) << AXIS_BITS };
            tree.nodes.extend([Node::leaf(0, 0); 2]);
            open.push((first + 1, range.start + middle..range.end));
            open.push((first, range.start..range.start + middle));
        }
        tree
    }

    pub fn leaves(&self) -> usize {
        self.leaves as usize
    }

    /// Number of nodes. Node 0 is the root; children come after their parents.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// The children of a node, or the index of its leaf as the error. Leaves below the first child come before those below the
    /// second.
    pub fn children(&self, node: usize) -> Result<[usize; 2], u32> {
        let Node { split, next } = self.nodes[node];
        let first = (next >> AXIS_BITS) as usize;
        if next & LEAF == LEAF { Err(split.to_bits()) } else { Ok([first, first + 1]) }
    }

    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>()
    }

    /// The key of a position and a unit normal in a tree with this scale.
    pub fn key(position: Vec3, normal: Vec3, scale: f32) -> CellKey {
        let n = normal * scale;
        [position.x, position.y, position.z, n.x, n.y, n.z]
    }

    /// The leaves of eight positions and normals. The eight descents are interleaved to hide memory latency.
    #[inline]
    pub(crate) fn leaves_of(&self, position: V3, normal: V3) -> [u32; LANES] {
        let n = normal * F::splat(self.scale);
        let none = F::splat(f32::NEG_INFINITY);
        let axes = [position.x, position.y, position.z, n.x, n.y, n.z, none, none];
        let axes = eight(|axis| axes[axis].to_array());
        let mut at = [0; LANES];
        loop {
            let mut moved = 0;
            at = eight(|lane| {
                let next = self.nodes[at[lane] as usize].next(|axis| axes[axis][lane]);
                moved |= next ^ at[lane];
                next
            });
            if moved == 0 {
                return eight(|lane| self.nodes[at[lane] as usize].split.to_bits());
            }
        }
    }

    /// The leaf of a position and a normal.
    #[inline]
    pub fn leaf(&self, position: Vec3, normal: Vec3) -> u32 {
        let [a, b, c, d, e, f] = Self::key(position, normal, self.scale);
        let key = [a, b, c, d, e, f, f32::NEG_INFINITY, f32::NEG_INFINITY];
        let mut at = 0;
        loop {
            let node = self.nodes[at as usize];
            if node.next & LEAF == LEAF {
                return node.split.to_bits();
            }
            at = node.next(|axis| key[axis]);
        }
    }
}

/// Splits keys near the median of the axis of largest variance: the axis, the split value, and the number of keys below it,
/// which come first. `None` if all keys are equal.
fn split(keys: &mut [CellKey]) -> Option<(usize, f32, usize)> {
    // Some hundred keys estimate the variances well enough.
    let step = keys.len().div_ceil(512);
    let (mut n, mut sums, mut squares) = (0.0, [0.0; 6], [0.0; 6]);
    for key in keys.iter().step_by(step) {
        n += 1.0;
        for axis in 0..6 {
            let x = f64::from(key[axis] - keys[0][axis]);
            sums[axis] += x;
            squares[axis] += x * x;
        }
    }
    let variances: [f64; 6] = std::array::from_fn(|axis| squares[axis] - sums[axis] * sums[axis] / n);
    let axis = (0..6).max_by(|a, b| variances[*a].total_cmp(&variances[*b]))?;
    let middle = keys.len() / 2;
    let (_, median, _) = keys.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    let median = median[axis];
    // Rounding must not split keys that are equal without it: on a flat floor, or by a facet's normal.
    let values = || keys.iter().map(|p| p[axis]);
    let tolerance = MIN_RELATIVE_DIFFERENCE * values().map(f32::abs).fold(0.0, f32::max);
    let largest = |part: &dyn Fn(f32) -> bool| values().filter(|x| part(*x)).max_by(f32::total_cmp);
    let smallest = |part: &dyn Fn(f32) -> bool| values().filter(|x| part(*x)).min_by(f32::total_cmp);
    let (low, high) = match largest(&|x| x < median - tolerance) {
        Some(low) => (low, smallest(&|x| x >= median - tolerance)?),
        None => (largest(&|x| x <= median + tolerance)?, smallest(&|x| x > median + tolerance)?),
    };
    let between = low + (high - low) / 2.0;
    let at = if between > low { between } else { high };
    let mut first = 0;
    for i in 0..keys.len() {
        if keys[i][axis] < at {
            keys.swap(first, i);
            first += 1;
        }
    }
    Some((axis, at, first))
}

/// Coordinates whose difference relative to the largest is smaller count as equal.
const MIN_RELATIVE_DIFFERENCE: f32 = 1e-5;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::SplitMix64;

    #[test]
    fn leaves_hold_as_many_as_they_may_and_keys_are_found_where_they_are() {
        let mut random = SplitMix64(5);
        let keys: Vec<_> = (0..5000)
            .map(|_| {
                let position = Vec3::new(random.f32(), 0.2 * random.f32(), 3.0);
                CellTree::key(position, if random.f32() < 0.3 { Vec3::Y } else { -Vec3::Y }, 1.0)
            })
            .collect();
        let tree = CellTree::new(keys.clone(), 1.0, 100, 1000);
        let mut counts = vec![0; tree.leaves()];
        let mut sides = vec![[false; 2]; tree.leaves()];
        for p in &keys {
            let (position, normal) = (Vec3::new(p[0], p[1], p[2]), Vec3::new(p[3], p[4], p[5]));
            let leaf = tree.leaf(position, normal) as usize;
            let mut eight = [keys[0]; LANES];
            eight[5] = *p;
            let of = |axis: usize| F::from(eight.map(|p| p[axis]));
            let eight = tree.leaves_of(V3 { x: of(0), y: of(1), z: of(2) }, V3 { x: of(3), y: of(4), z: of(5) });
            assert_eq!(eight[5] as usize, leaf);
            counts[leaf] += 1;
            sides[leaf][usize::from(p[4] > 0.0)] = true;
        }
        assert!(counts.iter().all(|n| (1..=100).contains(n)), "{counts:?}");
        assert!(sides.iter().all(|[a, b]| a != b), "the two sides of a wall are in one cell");
        assert!(CellTree::new(keys, 1.0, 1, 64).leaves() <= 64);
    }

    #[test]
    fn rounding_does_not_split_what_is_flat() {
        let mut random = SplitMix64(6);
        let normals: Vec<_> = (0..20).map(|_| crate::sampling::warp::sphere(random.f32(), random.f32())).collect();
        let mut rounded = |normal: Vec3| normal * (1.0 + 4.0 * f32::EPSILON * (random.f32() - 0.5));
        let keys: Vec<_> = (0..2000).map(|i| CellTree::key(Vec3::ZERO, rounded(normals[i % 20]), 1.0)).collect();
        let tree = CellTree::new(keys, 1.0, 150, 1000);
        assert_eq!(tree.leaves(), 20);
        for normal in normals {
            let near = (normal * (1.0 + 2.0 * f32::EPSILON), normal * (1.0 - 2.0 * f32::EPSILON));
            assert_eq!(tree.leaf(Vec3::ZERO, near.0), tree.leaf(Vec3::ZERO, near.1));
        }
    }

    #[test]
    fn equal_keys_are_one_leaf() {
        let key = CellTree::key(Vec3::ONE, Vec3::X, 2.0);
        assert_eq!(CellTree::new(vec![key; 1000], 2.0, 10, 100).leaves(), 1);
        assert_eq!(CellTree::new(Vec::new(), 2.0, 10, 100).leaves(), 1);
        let mut two = vec![key; 900];
        two.extend(vec![CellTree::key(Vec3::X, Vec3::X, 2.0); 100]);
        assert_eq!(CellTree::new(two, 2.0, 10, 1000).leaves(), 2);
    }
}
