//! Checks of placements, and the view that frames all of them.

use glam::{DAffine3, DVec3};

use super::nodes::Placement;
use super::transforms::is_visible;
use crate::error::{Error, Result};
use crate::scene::import::document::Document;
use crate::scene::import::report::Notes;
use crate::scene::{MAX_COORDINATE, Mesh, Scene};

/// Checks the corners of a mesh's box, untransformed and placed, against [`MAX_COORDINATE`].
/// Errors: A coordinate beyond it, with the node (`at`) and the mesh.
pub(crate) fn check_extent(corners: &[DVec3], world: &DAffine3, at: &str, mesh: &str) -> Result<()> {
    let moved = corners.iter().map(|&c| world.transform_point3(c));
    match corners.iter().copied().chain(moved).any(|p| p.abs().max_element() > f64::from(MAX_COORDINATE)) {
        true => Err(Error::Data(format!(
            "{at}: places {mesh} beyond {MAX_COORDINATE:e} m, where rays cannot be traced; scale the scene down"
        ))),
        false => Ok(()),
    }
}

/// Is the placement visible? Notes it if not.
pub(crate) fn keep_visible(placement: &Placement, notes: &mut Notes) -> bool {
    let visible = is_visible(&placement.world);
    if !visible {
        notes.not_loaded(
            &placement.at,
            "a placement with zero or infinite scale, or that is not finite: nothing to see",
        );
    }
    visible
}

/// Where the built scene's coordinates begin, in the file's: the eye of what is seen so far from the file's origin that 32 bits
/// would round it. Without a camera it is the middle of all things, which are near each other then.
pub fn origin(document: &Document) -> DVec3 {
    /// Metres; in sizes of what is seen.
    const FAR: f64 = 1000.0;
    const SIZES: f64 = 10.0;
    let worlds = document.world_transforms();
    let (mut eye, mut things) = (None, Vec::new());
    let mut stack: Vec<_> = document.roots.iter().rev().map(|&root| (root, true)).collect();
    while let Some((index, parent_visible)) = stack.pop() {
        let Ok(content) = document.nodes[index].content() else { continue };
        let visible = parent_visible && content.visible;
        stack.extend(document.nodes[index].children.iter().rev().map(|&child| (child, visible)));
        // Joints place skinned meshes.
        let skin = content.skin.and_then(|skin| document.skins.get(skin).ok());
        let at = worlds[skin.and_then(|skin| skin.joints.first()).copied().unwrap_or(index)].translation;
        things.extend((content.mesh.is_some() && visible && at.is_finite()).then_some(at));
        eye = eye.or(content.camera.map(|_| worlds[index].translation));
    }
    let middle = things.iter().sum::<DVec3>() / things.len().max(1) as f64;
    let distances = things.iter().map(|thing| thing.distance(eye.unwrap_or(middle)));
    let size = if eye.is_some() { distances.reduce(f64::min) } else { distances.reduce(f64::max) };
    let away = eye.unwrap_or(middle).length();
    let is_far = away >= FAR && away <= f64::from(MAX_COORDINATE) && size.is_some_and(|size| SIZES * size <= away);
    if is_far { eye.unwrap_or(middle).round() } else { DVec3::ZERO }
}

pub fn points<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> impl Iterator<Item = DVec3> {
    meshes.flat_map(|m| m.positions.iter()).map(|p| DVec3::from(p.map(f64::from)))
}

/// The eight corners of the points' bounding box; none without points.
pub fn corners(points: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
    let bounds = |b: Option<(DVec3, DVec3)>, p: DVec3| Some(b.map_or((p, p), |(low, high)| (low.min(p), high.max(p))));
    let Some((low, high)) = points.fold(None, bounds) else { return Vec::new() };
    let pick = |i: u32, axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
    (0..8).map(|i| DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2))).collect()
}

/// Visits the points of placed objects, each with its index, whether its meshes are in world space, and its transforms. Objects
/// with several placements enter by their bounding box.
pub(crate) fn visit_points(scene: &Scene, seen: &[(u32, bool, Vec<DAffine3>)], visit: &mut dyn FnMut(DVec3)) {
    for (object, baked, worlds) in seen {
        let range = scene.objects[*object as usize].meshes.clone().filter(|&mesh| scene.is_seen(mesh));
        let points = points(range.map(|mesh| scene.meshes[mesh as usize].as_ref()));
        match (baked, &worlds[..]) {
            (true, _) => points.for_each(&mut *visit),
            (false, [only]) => points.for_each(|p| visit(only.transform_point3(p))),
            _ => {
                let corners = corners(points);
                worlds
                    .iter()
                    .flat_map(|world| corners.iter().map(|&c| world.transform_point3(c)))
                    .for_each(&mut *visit);
            }
        }
    }
}
