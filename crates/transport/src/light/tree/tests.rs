use super::*;
use crate::light::LightSampleRecord;
use crate::sampling::{hash, warp};
use proptest::prelude::*;

fn number(seed: u32) -> f32 {
    (hash(seed) >> 8) as f32 / (1 << 24) as f32
}

/// A unit normal, or none: light from both sides counts.
fn normal(seed: u32) -> Vec3 {
    if seed.is_multiple_of(4) { Vec3::ZERO } else { warp::sphere(number(seed ^ 1), number(seed ^ 2)) }
}

/// Choices from the root to an emitter.
fn depth(tree: &LightTree, emitter: u32) -> usize {
    let up = |&node: &u32| Some(tree.nodes[node as usize].parent);
    std::iter::successors(Some(tree.leaves[emitter as usize]), up).take_while(|&node| node != 0).count()
}

fn emitters(n: u32, seed: u32) -> Vec<Emitter> {
    (0..n)
        .map(|i| {
            let number = |k: u32| number(seed ^ hash(16 * i + k));
            let low = Vec3::new(number(0), number(1), number(2)) * 10.0;
            Emitter {
                low,
                high: low + Vec3::new(number(3), number(4), number(5)),
                normal: warp::sphere(number(6), number(7)),
                spread: 0.0,
                power: if i % 7 == 3 { 0.0 } else { number(8).powi(4) + 1e-6 },
                two_sided: i % 5 == 0,
            }
        })
        .collect()
}

/// Learned from light-sample records at random positions, most of which have nearly no contribution.
fn learned(tree: &LightTree, emitters: u32, seed: u32) -> Option<LearnedLights> {
    let light_sample_record = |i: u32| {
        let number = |k: u32| number(seed ^ hash(8 * i + k + 7));
        let position = Vec3::new(number(0), number(1), number(2)) * 10.0;
        let emitter = (number(3) * emitters as f32) as u32;
        LightSampleRecord {
            position,
            normal: normal(seed ^ i),
            emitter,
            pixel: 0,
            contribution: number(4).powi(12) * 1e6,
        }
    };
    let light_sample_records: Vec<_> = (0..3000).map(light_sample_record).collect();
    LearnedLights::learn(tree, &light_sample_records, 3.0).filter(|_| !seed.is_multiple_of(3))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn choices_have_the_probabilities_that_are_stated(n in 1u32..200, seed in any::<u32>(), above in -1.0f32..2.0) {
        let emitters = emitters(n, seed);
        let Some(tree) = LightTree::new(&emitters) else { return Ok(()) };
        let p = Vec3::new(5.0, 10.0 * above, 5.0);
        let normal = normal(seed);
        let learned = learned(&tree, n, seed);
        let pmfs = |emitter| tree.pmfs(p, normal, emitter, learned.as_ref());
        let pmf: Vec<f64> = (0..n).map(|e| f64::from(pmfs(e)[1])).collect();
        // Whatever was learned: half as often as without, at least.
        prop_assert!((0..n).map(pmfs).all(|[by_tree, mixed]| mixed >= 0.4999 * by_tree));
        let sum: f64 = pmf.iter().sum();
        // Less than one where a cluster may shine here but none in it does; 1e-4: rounding of some ten products.
        prop_assert!(sum <= 1.0 + 1e-4, "{sum}");
        // The choice is monotone along the tree's leaves: an even grid counts each within a step at both ends.
        const STEPS: usize = 1 << 12;
        let mut count = vec![0u32; n as usize];
        for k in (0..STEPS).step_by(LANES) {
            let u = std::array::from_fn::<f32, LANES, _>(|lane| ((k + lane) as f32 + 0.5) / STEPS as f32);
            let (chosen, chance) = tree.sample(V3::splat(p), V3::splat(normal), F::from(u), learned.as_ref());
            for lane in 0..LANES {
                let chance = chance.as_array()[lane];
                if chance > 0.0 {
                    count[chosen[lane] as usize] += 1;
                    let [_, stated] = pmfs(chosen[lane]);
                    // A level: sum and quotient of a share near one are rounded, and what it leaves to one is off
                    // by as much, before factors of at most one; then the roundings of both products.
                    let rounding = f32::EPSILON * (1.0 + 4.0 * stated) * depth(&tree, chosen[lane]) as f32;
                    prop_assert!((chance - stated).abs() <= rounding, "{chance} {stated}");
                }
            }
        }
        for (e, &count) in count.iter().enumerate() {
            let share = f64::from(count) / STEPS as f64;
            prop_assert!((share - pmf[e]).abs() <= 2.0 / STEPS as f64 + 1e-4, "{e}: {share} {}", pmf[e]);
        }
    }

    #[test]
    fn what_may_shine_here_can_be_chosen(n in 1u32..100, seed in any::<u32>(), above in -1.0f32..2.0) {
        let emitters = emitters(n, seed);
        let Some(tree) = LightTree::new(&emitters) else { return Ok(()) };
        let p = Vec3::new(5.0, 10.0 * above, 5.0);
        let normal = normal(seed);
        for (i, e) in (0..).zip(&emitters) {
            let point = e.low + (e.high - e.low) * number(seed ^ i);
            let wi = (point - p).normalize();
            let facing = -e.normal.dot(wi);
            let facing = if e.two_sided { facing.abs() } else { facing };
            // Clear of rounding.
            if e.power > 0.0 && facing > 1e-3 && (normal == Vec3::ZERO || normal.dot(wi) > 1e-3) {
                prop_assert!(tree.pmfs(p, normal, i, None)[1] > 0.0, "{i}");
            }
        }
    }
}

#[test]
fn a_tree_that_threads_have_divided_among_them_is_that_of_one() {
    let emitters = emitters(3 * MIN_FORK as u32, 5);
    let mut shining: Vec<u32> = (0..emitters.len() as u32).filter(|&i| emitters[i as usize].power > 0.0).collect();
    let empty = Node { bounds: Bounds::default(), children: 0, emitter: 0, parent: 0 };
    let mut nodes = vec![empty; 2 * shining.len() - 1];
    grow(&emitters, &mut shining, &mut nodes, FORKS);
    let mut serial = LightTree { nodes, leaves: vec![u32::MAX; emitters.len()] };
    serial.sort();
    let tree = LightTree::new(&emitters).unwrap();
    assert_eq!(format!("{:?}", tree.nodes), format!("{:?}", serial.nodes));
    assert_eq!(tree.leaves, serial.leaves);
    // Nodes come after their parents, in the order of power.
    for (at, node) in tree.nodes.iter().enumerate().skip(1) {
        assert!((node.parent as usize) < at);
        let first = tree.nodes[node.parent as usize].children as usize;
        assert!(at == first || at == first + 1);
    }
    for (emitter, &leaf) in tree.leaves.iter().enumerate().filter(|(_, leaf)| **leaf != u32::MAX) {
        assert_eq!((tree.nodes[leaf as usize].children, tree.nodes[leaf as usize].emitter), (0, emitter as u32));
    }
}
