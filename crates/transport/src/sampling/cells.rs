//! Cells in space: a tree over places, which are positions, and normals, so that the two sides of a thin wall are apart.

use glam::Vec3;

use crate::lanes::{F, LANES, V3};

/// A place: position, and the normal times [`Tree`]'s scale.
pub type Place = [f32; 6];

/// Of a node's third word: no axis, a leaf.
const LEAF: u32 = 7;
/// Bits of a node's axis.
const AXIS_BITS: u32 = 3;

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Places below go to the first child.
    split: f32,
    /// Axis, and above it the first child's number (the second follows it), or the leaf's.
    next: u32,
}

/// A k-d tree.
#[derive(Debug, Clone)]
pub struct Tree {
    nodes: Vec<Node>,
    /// What normals are worth in metres.
    scale: f32,
    leaves: u32,
}

impl Tree {
    /// A tree whose leaves hold at most `most` of `places` ([`place`](Self::place)s of the same `scale`), as far as
    /// places differ, and with at most `most_leaves` leaves.
    pub fn new(mut places: Vec<Place>, scale: f32, most: usize, most_leaves: usize) -> Self {
        let most = most.max(2 * places.len() / most_leaves.max(1)).max(1);
        let mut tree = Self { nodes: vec![Node { split: 0.0, next: LEAF }], scale, leaves: 0 };
        let mut open = vec![(0, 0..places.len())];
        while let Some((node, range)) = open.pop() {
            let here = &mut places[range.clone()];
            let room = tree.leaves as usize + open.len() + 2 <= most_leaves;
            let split = if here.len() > most && room { split(here) } else { None };
            let Some((axis, at, middle)) = split else {
                tree.nodes[node].next = LEAF | tree.leaves << AXIS_BITS;
                tree.leaves += 1;
                continue;
            };
            let first = tree.nodes.len();
            tree.nodes[node] = Node { split: at, next: axis as u32 | (first as u32) << AXIS_BITS };
            tree.nodes.extend([Node { split: 0.0, next: LEAF }; 2]);
            open.push((first + 1, range.start + middle..range.end));
            open.push((first, range.start..range.start + middle));
        }
        tree
    }

    /// How many leaves.
    pub fn leaves(&self) -> usize {
        self.leaves as usize
    }

    /// How many nodes: the root is the first, children come after their parents.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// A node's children, or its leaf.
    pub fn below(&self, node: usize) -> Result<[usize; 2], u32> {
        let next = self.nodes[node].next;
        let number = next >> AXIS_BITS;
        if next & LEAF == LEAF { Err(number) } else { Ok([number as usize, number as usize + 1]) }
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>()
    }

    /// The place of a position and a unit normal, in a tree of such a scale.
    pub fn place(position: Vec3, normal: Vec3, scale: f32) -> Place {
        let n = normal * scale;
        [position.x, position.y, position.z, n.x, n.y, n.z]
    }

    /// The leaves that hold eight places: eight descents side by side, which wait less for memory than one after the other.
    #[inline]
    pub fn leaves_of(&self, position: V3, normal: V3) -> [u32; LANES] {
        let n = normal * F::splat(self.scale);
        let axes = [position.x, position.y, position.z, n.x, n.y, n.z, F::ZERO, F::ZERO].map(F::to_array);
        let mut at = [0u32; LANES];
        loop {
            let mut arrived = true;
            for (lane, at) in at.iter_mut().enumerate() {
                let node = self.nodes[*at as usize];
                let axis = node.next & LEAF;
                let below = (node.next >> AXIS_BITS) + u32::from(axes[axis as usize][lane] >= node.split);
                *at = if axis == LEAF { *at } else { below };
                arrived &= axis == LEAF;
            }
            if arrived {
                return at.map(|node| self.nodes[node as usize].next >> AXIS_BITS);
            }
        }
    }

    /// The leaf that holds a place.
    #[inline]
    pub fn leaf(&self, position: Vec3, normal: Vec3) -> u32 {
        let [a, b, c, d, e, f] = Self::place(position, normal, self.scale);
        let place = [a, b, c, d, e, f, 0.0, 0.0];
        let mut node = self.nodes[0];
        loop {
            let (axis, next) = (node.next & LEAF, node.next >> AXIS_BITS);
            if axis == LEAF {
                return next;
            }
            node = self.nodes[next as usize + usize::from(place[axis as usize] >= node.split)];
        }
    }
}

/// Parts places at the middle of the axis along which they vary most: axis, where, and how many come first. `None` where all
/// are the same.
fn split(places: &mut [Place]) -> Option<(usize, f32, usize)> {
    // A few hundred of them know it well enough.
    let step = places.len().div_ceil(512);
    let (mut n, mut sums, mut squares) = (0.0, [0.0; 6], [0.0; 6]);
    for place in places.iter().step_by(step) {
        n += 1.0;
        for axis in 0..6 {
            let x = f64::from(place[axis] - places[0][axis]);
            sums[axis] += x;
            squares[axis] += x * x;
        }
    }
    let variances: [f64; 6] = std::array::from_fn(|axis| squares[axis] - sums[axis] * sums[axis] / n);
    let axis = (0..6).max_by(|a, b| variances[*a].total_cmp(&variances[*b]))?;
    let middle = places.len() / 2;
    let (_, median, _) = places.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    let median = median[axis];
    // Many have the same number but for roundings, which must not part them: on a flat floor, or a facet's normal.
    let values = || places.iter().map(|p| p[axis]);
    let alike = SAME * values().map(f32::abs).fold(0.0, f32::max);
    let most = |part: &dyn Fn(f32) -> bool| values().filter(|x| part(*x)).max_by(f32::total_cmp);
    let least = |part: &dyn Fn(f32) -> bool| values().filter(|x| part(*x)).min_by(f32::total_cmp);
    let (low, high) = match most(&|x| x < median - alike) {
        Some(low) => (low, least(&|x| x >= median - alike)?),
        None => (most(&|x| x <= median + alike)?, least(&|x| x > median + alike)?),
    };
    let between = low + (high - low) / 2.0;
    let at = if between > low { between } else { high };
    let mut first = 0;
    for i in 0..places.len() {
        if places[i][axis] < at {
            places.swap(first, i);
            first += 1;
        }
    }
    Some((axis, at, first))
}

/// Numbers that differ by less, over the largest, are the same.
const SAME: f32 = 1e-5;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::SplitMix64;

    #[test]
    fn leaves_hold_as_many_as_they_may_and_places_are_found_where_they_are() {
        let mut random = SplitMix64(5);
        let places: Vec<_> = (0..5000)
            .map(|_| {
                let position = Vec3::new(random.f32(), 0.2 * random.f32(), 3.0);
                Tree::place(position, if random.f32() < 0.3 { Vec3::Y } else { -Vec3::Y }, 1.0)
            })
            .collect();
        let tree = Tree::new(places.clone(), 1.0, 100, 1000);
        let mut counts = vec![0; tree.leaves()];
        let mut sides = vec![[false; 2]; tree.leaves()];
        for p in &places {
            let (position, normal) = (Vec3::new(p[0], p[1], p[2]), Vec3::new(p[3], p[4], p[5]));
            let leaf = tree.leaf(position, normal) as usize;
            let mut eight = [places[0]; LANES];
            eight[5] = *p;
            let of = |axis: usize| F::from(eight.map(|p| p[axis]));
            let eight = tree.leaves_of(V3 { x: of(0), y: of(1), z: of(2) }, V3 { x: of(3), y: of(4), z: of(5) });
            assert_eq!(eight[5] as usize, leaf);
            counts[leaf] += 1;
            sides[leaf][usize::from(p[4] > 0.0)] = true;
        }
        assert!(counts.iter().all(|n| (1..=100).contains(n)), "{counts:?}");
        assert!(sides.iter().all(|[a, b]| a != b), "the two sides of a wall are in one cell");
        assert!(Tree::new(places, 1.0, 1, 64).leaves() <= 64);
    }

    #[test]
    fn roundings_do_not_part_what_is_flat() {
        let mut random = SplitMix64(6);
        let normals: Vec<_> = (0..20).map(|_| crate::sampling::warp::sphere(random.f32(), random.f32())).collect();
        let mut rounded = |normal: Vec3| normal * (1.0 + 4.0 * f32::EPSILON * (random.f32() - 0.5));
        let places: Vec<_> = (0..2000).map(|i| Tree::place(Vec3::ZERO, rounded(normals[i % 20]), 1.0)).collect();
        let tree = Tree::new(places, 1.0, 150, 1000);
        assert_eq!(tree.leaves(), 20);
        for normal in normals {
            let near = (normal * (1.0 + 2.0 * f32::EPSILON), normal * (1.0 - 2.0 * f32::EPSILON));
            assert_eq!(tree.leaf(Vec3::ZERO, near.0), tree.leaf(Vec3::ZERO, near.1));
        }
    }

    #[test]
    fn places_that_cannot_be_told_apart_are_one_leaf() {
        let place = Tree::place(Vec3::ONE, Vec3::X, 2.0);
        assert_eq!(Tree::new(vec![place; 1000], 2.0, 10, 100).leaves(), 1);
        assert_eq!(Tree::new(Vec::new(), 2.0, 10, 100).leaves(), 1);
        let mut two = vec![place; 900];
        two.extend(vec![Tree::place(Vec3::X, Vec3::X, 2.0); 100]);
        assert_eq!(Tree::new(two, 2.0, 10, 1000).leaves(), 2);
    }
}
