//! The binary and the eight-wide tree of obvhs behind one type.

use obvhs::aabb::Aabb;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::{Bvh2, reinsertion::ReinsertionOptimizer};
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::{CwBvh, node::CwBvhNode};
use obvhs::ploc::PlocBuilder;
use obvhs::ray::{Ray, RayHit};
use obvhs::splits::split_aabbs_preset;
use obvhs::triangle::Triangle;

use super::options::{ObvhsOptions, TreeKind};
use crate::{Error, Result};

/// Boxes are enlarged by this fraction of their tree's largest coordinate, so that rounding in box tests loses no hit.
const BOX_SLACK: f32 = 1.0 / (1 << 20) as f32;

/// Levels of the traversal stack of the eight-wide tree; obvhs silently drops nodes of deeper trees.
const MAX_LEVELS: u32 = 32;

pub(super) enum Tree {
    Binary(Bvh2),
    EightWide(CwBvh),
}

impl Tree {
    /// Builds a tree over boxes, enlarged by [`BOX_SLACK`]. If `triangles` are given, large ones are split.
    pub(super) fn build(mut boxes: Vec<Aabb>, triangles: Option<&[Triangle]>, options: &ObvhsOptions) -> Result<Self> {
        if boxes.is_empty() {
            return Ok(Tree::EightWide(CwBvh::default()));
        }
        let choices = options.parameters();
        let mut order = (0..boxes.len() as u32).collect::<Vec<_>>();
        if let Some(triangles) = triangles {
            let areas = || boxes.iter().map(Aabb::half_area);
            let (mean, largest) = (areas().sum::<f32>() / boxes.len() as f32, areas().fold(0.0, f32::max));
            split_aabbs_preset(&mut boxes, &mut order, triangles, mean, largest);
        }
        let bounds = union(&boxes);
        let slack = BOX_SLACK * bounds.min.abs().max(bounds.max.abs()).max_element();
        for one in &mut boxes {
            *one = Aabb::new(one.min - slack, one.max + slack);
        }
        // The steps of `build_cwbvh_from_tris` and `build_bvh2_from_tris`, which in debug builds also validate the tree, with
        // absolute tolerances.
        let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
            choices.ploc_search_distance,
            &boxes,
            order,
            choices.sort_precision,
            choices.search_depth_threshold,
        );
        binary.uses_spatial_splits = triangles.is_some();
        let mut optimizer = ReinsertionOptimizer::default();
        optimizer.run(&mut binary, choices.reinsertion_batch_ratio, None);
        if options.tree == TreeKind::Binary {
            collapse(&mut binary, choices.max_prims_per_leaf.clamp(1, 255), choices.collapse_traversal_cost);
            let again = choices.reinsertion_batch_ratio * choices.post_collapse_reinsertion_batch_ratio_multiplier;
            optimizer.run(&mut binary, again, None);
            // Only the optimizer needs these.
            binary.parents = Vec::new();
            binary.primitives_to_nodes = Vec::new();
            return Ok(Tree::Binary(binary));
        }
        let bvh = bvh2_to_cwbvh(&binary, choices.max_prims_per_leaf.clamp(1, 3), true, false);
        let depth = depth(&bvh);
        if depth > MAX_LEVELS {
            return Err(Error::Data(format!(
                "the scene's triangles overlap so much that the tree of obvhs has {depth} levels, more than the {MAX_LEVELS} \
                 that it can traverse; use --rays embree"
            )));
        }
        Ok(Tree::EightWide(bvh))
    }

    /// Indices of the boxes, in the order of the leaves.
    #[inline(always)]
    pub(super) fn order(&self) -> &[u32] {
        match self {
            Tree::Binary(bvh) => &bvh.primitive_indices,
            Tree::EightWide(bvh) => &bvh.primitive_indices,
        }
    }

    /// Calls `test` with positions in [`Self::order`] until the closest hit is found.
    #[inline(always)]
    pub(super) fn closest(&self, ray: Ray, hit: &mut RayHit, test: impl FnMut(&Ray, usize) -> f32) {
        match self {
            Tree::Binary(bvh) => bvh.ray_traverse(ray, hit, test),
            Tree::EightWide(bvh) => bvh.ray_traverse(ray, hit, test),
        };
    }

    /// Calls `test` with positions in [`Self::order`] until there is a hit. Returns whether there is none.
    #[inline(always)]
    pub(super) fn misses(&self, ray: Ray, test: impl FnMut(&Ray, usize) -> f32) -> bool {
        match self {
            Tree::Binary(bvh) => bvh.ray_traverse_miss(ray, test),
            Tree::EightWide(bvh) => bvh.ray_traverse_miss(ray, test),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let nodes = match self {
            Tree::Binary(bvh) => bvh.nodes.len() * size_of::<Bvh2Node>(),
            Tree::EightWide(bvh) => bvh.nodes.len() * size_of::<CwBvhNode>(),
        };
        nodes + size_of_val(self.order())
    }
}

pub(super) fn union(boxes: &[Aabb]) -> Aabb {
    boxes.iter().fold(Aabb::empty(), |all, one| all.union(one))
}

/// Number of levels. Children are stored after their parent.
fn depth(bvh: &CwBvh) -> u32 {
    let mut levels = vec![1; bvh.nodes.len()];
    for (at, node) in bvh.nodes.iter().enumerate() {
        let children = node.child_base_idx as usize..;
        let below = levels[at] + 1;
        for child in children.take(node.imask.count_ones() as usize) {
            levels[child] = below;
        }
    }
    levels.into_iter().max().unwrap_or(0)
}
