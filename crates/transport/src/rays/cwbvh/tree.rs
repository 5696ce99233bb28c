//! obvhs' two trees behind one type.

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

use super::{ObvhsOptions, TreeKind};
use crate::{Error, Result};

/// Boxes grow by this share of their tree's largest coordinate, so that rounding in the box tests loses no hit.
const SLACK: f32 = 1.0 / (1 << 20) as f32;

/// Levels that obvhs' traversal stack of the eight-wide tree holds; it forgets nodes of deeper trees silently.
const DEEPEST: u32 = 32;

pub(super) enum Tree {
    Two(Bvh2),
    Eight(CwBvh),
}

impl Tree {
    /// A tree over boxes, which grow by [`SLACK`]; `triangles` are what is in them, where they are to be split.
    pub(super) fn build(mut boxes: Vec<Aabb>, triangles: Option<&[Triangle]>, options: &ObvhsOptions) -> Result<Self> {
        if boxes.is_empty() {
            return Ok(Tree::Eight(CwBvh::default()));
        }
        let choices = options.parameters();
        let mut order = (0..boxes.len() as u32).collect::<Vec<_>>();
        if let Some(triangles) = triangles {
            let areas = || boxes.iter().map(Aabb::half_area);
            let (mean, largest) = (areas().sum::<f32>() / boxes.len() as f32, areas().fold(0.0, f32::max));
            split_aabbs_preset(&mut boxes, &mut order, triangles, mean, largest);
        }
        let bounds = union(&boxes);
        let slack = SLACK * bounds.min.abs().max(bounds.max.abs()).max_element();
        for one in &mut boxes {
            *one = Aabb::new(one.min - slack, one.max + slack);
        }
        // As `build_cwbvh_from_tris` and `build_bvh2_from_tris`, which validate with absolute tolerances in debug builds.
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
        if options.tree == TreeKind::Two {
            collapse(&mut binary, choices.max_prims_per_leaf.clamp(1, 255), choices.collapse_traversal_cost);
            let again = choices.reinsertion_batch_ratio * choices.post_collapse_reinsertion_batch_ratio_multiplier;
            optimizer.run(&mut binary, again, None);
            // Queries need neither; what was needed to optimise is not kept.
            binary.parents = Vec::new();
            binary.primitives_to_nodes = Vec::new();
            return Ok(Tree::Two(binary));
        }
        let bvh = bvh2_to_cwbvh(&binary, choices.max_prims_per_leaf.clamp(1, 3), true, false);
        let depth = depth(&bvh);
        if depth > DEEPEST {
            return Err(Error::Data(format!(
                "the scene's triangles overlap so much that obvhs' tree has {depth} levels, more than the {DEEPEST} that \
                 it can walk; use --rays embree"
            )));
        }
        Ok(Tree::Eight(bvh))
    }

    /// Which box each place in a leaf holds.
    #[inline(always)]
    pub(super) fn order(&self) -> &[u32] {
        match self {
            Tree::Two(bvh) => &bvh.primitive_indices,
            Tree::Eight(bvh) => &bvh.primitive_indices,
        }
    }

    /// Calls `test` with places in leaves until nothing nearer can come.
    #[inline(always)]
    pub(super) fn closest(&self, ray: Ray, hit: &mut RayHit, test: impl FnMut(&Ray, usize) -> f32) {
        match self {
            Tree::Two(bvh) => bvh.ray_traverse(ray, hit, test),
            Tree::Eight(bvh) => bvh.ray_traverse(ray, hit, test),
        };
    }

    /// Calls `test` with places in leaves until there is a hit; is there none?
    #[inline(always)]
    pub(super) fn misses(&self, ray: Ray, test: impl FnMut(&Ray, usize) -> f32) -> bool {
        match self {
            Tree::Two(bvh) => bvh.ray_traverse_miss(ray, test),
            Tree::Eight(bvh) => bvh.ray_traverse_miss(ray, test),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let nodes = match self {
            Tree::Two(bvh) => bvh.nodes.len() * size_of::<Bvh2Node>(),
            Tree::Eight(bvh) => bvh.nodes.len() * size_of::<CwBvhNode>(),
        };
        nodes + size_of_val(self.order())
    }
}

pub(super) fn union(boxes: &[Aabb]) -> Aabb {
    boxes.iter().fold(Aabb::empty(), |all, one| all.union(one))
}

/// Levels of nodes. Children come after their parent.
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
