//! Builds the scene from a checked document.

mod animated_bounds;
mod cache;
mod cameras;
mod count;
mod decode;
mod deform;
mod geometry;
mod lights;
mod materials;
mod nodes;
mod placements;
mod pose;
mod primitive;
mod reader;
mod skins;
mod tangents;
mod textures;
mod time_samples;
mod transforms;
mod unshown;

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DMat4, DVec3};
use rayon::prelude::*;
use serde_json::Value;
use tracing::debug;

use crate::error::Result;
use crate::scene::import::document::Document;
use crate::scene::import::document::extensions::{Support, support};
use crate::scene::import::document::primitives::{Mesh as MeshOfDocument, Primitive};
use crate::scene::import::options::Pose;
use crate::scene::import::report::{ImportReport, Notes};
use crate::scene::{self, Camera, Framing, Instance, Motion, Object, Scene};

use animated_bounds::Played;
pub use cache::ImportCache;
use cache::{CacheKey, CachedObject, Objects, attribute_needs};
use count::count;
pub use count::{image_bytes, mesh_bytes};
use deform::{MeshPose, MeshPoses};
use materials::MaterialTable;
use nodes::{FlattenedScene, ObjectKey, Placement, flatten};
pub use placements::origin;
use placements::{check_extent, corners, keep_visible, points, visit_points};
use primitive::Draft;
use reader::Reader;
use skins::joint_matrices;
use textures::TextureTable;
use time_samples::TimeSamples;
pub use time_samples::play;
use transforms::{is_flat, is_visible, lost_direction, thickened};
use unshown::{note_document, note_extensions, note_faults, note_unplaced};

/// The document to build, with the state of its animations.
pub struct ShownDocument<'a> {
    /// The document at the picture's own time.
    pub document: &'a Document,
    /// The JSON at rest and the pose, if animations are played. Otherwise the document is in its rest pose.
    pub posed: Option<(&'a Value, &'a Pose)>,
    pub times: &'a TimeSamples,
}

/// Builds the scene. Reuses what `cache` holds of earlier imports, adds to the document's notes, and fills the report's
/// extensions, notes and counts.
///
/// # Errors
/// Faulty elements that the shown scene needs, data that breaks the specification, memory out of proportion to the file.
pub fn build(
    &ShownDocument { document, posed, times }: &ShownDocument,
    file_bytes: u64,
    cache: &ImportCache,
    mut notes: Notes,
    report: &mut ImportReport,
) -> Result<Scene> {
    note_document(document, document.variant.is_some(), posed.is_some(), &mut notes);
    let reader = Reader::new(document, file_bytes);
    let textures = TextureTable::new(file_bytes);
    let mut assembly = Assembly {
        document,
        times,
        reader,
        textures,
        materials: MaterialTable::default(),
        scene: Scene::default(),
        framed_objects: Vec::new(),
        played: None,
        drafts: Vec::new(),
        // A document in its rest pose is imported once: there is nothing to reuse.
        reuse: posed.map(|_| ObjectReuse { previous: cache.objects(), current: Objects::default() }),
    };
    let flattened = flatten(document, times, &mut assembly.reader, &mut notes)?;
    // Cached meshes need no decoding. If only another pose is cached, `read_cached` decodes the mesh.
    let is_cached = |mesh: usize| assembly.reuse.as_ref().is_some_and(|s| s.previous.keys().any(|key| key.is_of(mesh)));
    let meshes = flattened.objects.iter().filter(|(key, _)| !is_cached(key.mesh));
    let meshes = meshes.filter_map(|(key, _)| document.meshes.get(key.mesh).ok());
    let start = Instant::now();
    assembly.reader.unpack(meshes.flat_map(|mesh| &mesh.primitives))?;
    debug!("geometry unpacked: {:.3} s", start.elapsed().as_secs_f64());
    assembly.played = posed.map(|(_, pose)| cache.played(&mut assembly.reader, pose)).transpose()?.flatten();
    for (key, placements) in &flattened.objects {
        assembly.place(key, placements, &flattened, &mut notes)?;
    }
    let placed: HashSet<usize> = flattened.objects.iter().map(|(key, _)| key.mesh).collect();
    note_unplaced(document, &placed, &mut notes);

    let Assembly { mut reader, textures, materials, mut scene, framed_objects, drafts, reuse, played, .. } = assembly;
    scene.origin = document.origin;
    let start = Instant::now();
    let finished: Vec<_> = drafts.into_par_iter().map(|(i, draft)| (i, Arc::new(draft.finish()))).collect();
    finished.into_iter().for_each(|(i, mesh)| scene.meshes[i] = mesh);
    debug!("tangents made: {:.3} s", start.elapsed().as_secs_f64());
    if let (Some(played), Some((json, _))) = (played, posed) {
        let start = Instant::now();
        // Rounded alike, whether stored in world space or not, so that every frame has the same.
        let still = |visit: &mut dyn FnMut(DVec3)| {
            visit_points(&scene, &framed_objects, &mut |p| visit(p.as_vec3().as_dvec3()));
        };
        let reach = played.reached.get_or_init(|| played.reach(&mut reader, json, &still).map(Arc::new));
        scene.reach.clone_from(reach);
        debug!("bounds over the animation: {:.6} s", start.elapsed().as_secs_f64());
    }
    let fitted = |scene: &Scene| {
        let mut framing = Framing::default();
        visit_points(scene, &framed_objects, &mut |p| framing.include(p));
        framing
    };
    let is_framed = flattened.cameras.is_empty();
    let reached = || scene.reach.as_ref().map(|reach| reach.framing.clone());
    let framing = is_framed.then(|| reached().unwrap_or_else(|| fitted(&scene)));
    if let Some(reuse) = reuse {
        cache.set_objects(reuse.current);
    }
    note_faults(document, scene.instances.is_empty(), &mut notes)?;
    materials.note_unused(document, &mut notes);
    textures.note_unused(document, &mut notes);
    scene.materials = materials.materials;
    (scene.lights, scene.light_nodes) = (flattened.lights, flattened.light_nodes);
    scene.cameras = flattened.cameras;
    scene.cameras.extend(framing.map(Camera::framed));
    textures.decode(document, file_bytes, cache, &mut scene, &mut notes)?;
    // What has no alpha anywhere is known once its texture is.
    if is_framed && scene.reach.is_none() && (0..scene.meshes.len() as u32).any(|mesh| !scene.is_seen(mesh)) {
        scene.cameras = vec![Camera::framed(fitted(&scene))];
    }
    report.counts = count(&scene);
    for name in document.extensions.keys().cloned() {
        match support(&name) {
            Support::Full | Support::NoEffect => report.extensions_used.push(name),
            Support::Ignored(_) => report.extensions_ignored.push(name),
        }
    }
    report.scenes.clone_from(&document.scene_names);
    report.variants.clone_from(&document.variants);
    let animation = |i| document.animations.get(i).ok().map(|animation| animation.name.clone());
    let name = |i| animation(i).filter(|name| !name.is_empty()).unwrap_or_else(|| format!("animations[{i}]"));
    report.animations = (0..document.animations.len()).map(name).collect();
    report.notes = notes.into_list();
    Ok(scene)
}

struct Assembly<'a> {
    document: &'a Document,
    times: &'a TimeSamples,
    reader: Reader<'a>,
    textures: TextureTable,
    materials: MaterialTable,
    scene: Scene,
    /// For a scene without a camera, or of which something moves: objects that do not, whether their meshes are in world space, and
    /// their transforms.
    framed_objects: Vec<(u32, bool, Vec<DAffine3>)>,
    /// What an animation moves; `None` if nothing.
    played: Option<Arc<Played>>,
    /// Meshes that need tangents, with the index of their stand-in in the scene; they are finished in parallel.
    drafts: Vec<(usize, Draft)>,
    /// `None` without animation.
    reuse: Option<ObjectReuse>,
}

/// Weights of morph targets, and joint matrices of a skin.
type Form = (Vec<f32>, Option<Vec<DMat4>>);

/// The only placement of an object that does not move, with its transforms one frame before and after if they differ.
type SinglePlacement<'a> = (&'a Placement, Option<[DAffine3; 2]>);

/// Transforms of a placement over time: at the time samples of the shutter, `None` if they do not change; one frame before and
/// after, `None` if equal to the picture's.
type PlacementTimes = (Option<Vec<DAffine3>>, Option<[DAffine3; 2]>);

/// Objects of the previous import of the same files, and of this one.
struct ObjectReuse {
    previous: Objects,
    current: Objects,
}

impl Assembly<'_> {
    /// Reads an object's meshes and places them. Placements that flatten it have meshes of their own.
    fn place(
        &mut self,
        key: &ObjectKey,
        placements: &[Placement],
        flattened: &FlattenedScene,
        notes: &mut Notes,
    ) -> Result<()> {
        let visible: Vec<&Placement> = placements.iter().filter(|p| keep_visible(p, notes)).collect();
        let (flat, solid): (Vec<&Placement>, Vec<&Placement>) = visible.into_iter().partition(|p| is_flat(&p.world));
        self.place_alike(key, &solid, flattened, notes)?;
        self.place_alike(key, &flat, flattened, notes)
    }

    /// Reads an object's meshes for placements of which all or none are flat.
    fn place_alike(
        &mut self,
        key: &ObjectKey,
        placements: &[&Placement],
        flattened: &FlattenedScene,
        notes: &mut Notes,
    ) -> Result<()> {
        let document = self.document;
        let mesh = document.meshes.get(key.mesh)?;
        let worlds = &flattened.worlds;
        let joints = self.joints(key, &|node| worlds[node])?;
        let start = self.scene.meshes.len() as u32;
        if placements.is_empty() {
            return Ok(());
        }
        let weights: Vec<f32> = key.weights.iter().map(|bits| f32::from_bits(*bits)).collect();
        let forms = self.forms(key, worlds)?;
        let forms: Vec<MeshPose> =
            forms.iter().map(|(w, joints)| MeshPose { weights: w, joints: joints.as_deref() }).collect();
        let picture = MeshPose { weights: &weights, joints: joints.as_deref() };
        let changing = |forms: &[MeshPose]| forms.iter().any(|form| *form != picture);
        let (shutter, adjacent_frames) = forms.split_at(self.times.shutter.min(forms.len()));
        let [shutter, adjacent_frames] = [shutter, adjacent_frames].map(|f| if changing(f) { f } else { &[] });
        let poses = MeshPoses { picture, shutter, adjacent_frames };
        // The transform is baked into the meshes if the object is placed once and does not move.
        let single = match placements {
            [placement] => match self.placement_times(placement, notes) {
                (Some(_), _) => None,
                (None, adjacent_frames) => Some((*placement, adjacent_frames)),
            },
            _ => None,
        };
        // The direction in which they are flattened, if it is one.
        let mut lost: Vec<DVec3> =
            placements.iter().filter(|p| is_flat(&p.world)).map(|p| lost_direction(&p.world.matrix3)).collect();
        let flat = !lost.is_empty();
        lost.dedup();
        let lost = <[DVec3; 1]>::try_from(lost).ok().map(|[lost]| lost);
        if self.reuse.is_some() {
            self.read_cached(key, mesh, &poses, (single, lost), notes)?;
        } else {
            for (_, draft) in self.read(mesh, &poses, (single, lost), notes)? {
                if draft.needs_tangents() && !flat {
                    let outline = Arc::new(draft.outline());
                    self.drafts.push((self.scene.meshes.len(), draft));
                    self.scene.meshes.push(outline);
                } else {
                    self.scene.meshes.push(Arc::new(draft.finish()));
                }
            }
        }
        if flat {
            // Every normal is that of the plane, which triangles have.
            self.scene.meshes[start as usize..].iter_mut().for_each(|mesh| Arc::make_mut(mesh).normals = None);
        }
        let meshes = start..self.scene.meshes.len() as u32;
        if meshes.is_empty() {
            return Ok(());
        }
        let object = self.scene.objects.len() as u32;
        self.scene.objects.push(Object { name: mesh.name.clone(), meshes });
        if flattened.cameras.is_empty() || self.played.is_some() {
            let still =
                |placement: &&&Placement| self.played.as_ref().is_none_or(|played| played.is_still(placement.from));
            let worlds: Vec<_> = placements.iter().filter(still).map(|placement| placement.world).collect();
            self.framed_objects.extend((!worlds.is_empty()).then_some((object, single.is_some(), worlds)));
        }
        if let Some((placement, _)) = single {
            self.scene.instances.push(placement.instance(object));
            return Ok(());
        }
        self.add_instances(object, mesh, placements, notes)
    }

    /// Adds the placements of an object whose meshes are in object space.
    fn add_instances(
        &mut self,
        object: u32,
        mesh: &MeshOfDocument,
        placements: &[&Placement],
        notes: &mut Notes,
    ) -> Result<()> {
        let Object { meshes, .. } = &self.scene.objects[object as usize];
        let meshes = &self.scene.meshes[meshes.start as usize..meshes.end as usize];
        let corners = corners(points(meshes.iter().map(Arc::as_ref)));
        let thick = |worlds: Vec<DAffine3>| worlds.iter().map(|world| thickened(world, &corners)).collect::<Vec<_>>();
        for placement in placements {
            // One after the other: transforms at all times take more memory than what is kept of them.
            let (shutter, adjacent_frames) = self.placement_times(placement, notes);
            for world in [&placement.world].into_iter().chain(shutter.iter().flatten()) {
                check_extent(&corners, world, &placement.at, &mesh.at)?;
            }
            self.scene.instances.push(Instance {
                transform: Some(thickened(&placement.world, &corners).as_affine3a()),
                motion: shutter.and_then(|transforms| Motion::new(&thick(transforms))).map(Arc::new),
                adjacent_frames: adjacent_frames.map(|both| both.map(|w| thickened(&w, &corners).as_affine3a())),
                ..placement.instance(object)
            });
        }
        Ok(())
    }

    /// May the animation that is played change the primitive's alpha? All its frames have one view.
    fn fades(&self, primitive: &Primitive) -> bool {
        self.reuse.is_some() && primitive.material.is_some_and(|index| self.document.fades(index))
    }

    /// Morph weights and joint matrices at each time sample; none if they cannot change.
    fn forms(&mut self, key: &ObjectKey, worlds: &[DAffine3]) -> Result<Vec<Form>> {
        let (times, mut forms) = (self.times, Vec::new());
        let is_still = key.skin.is_none() && key.weights_over_time.is_empty();
        for i in 0..if is_still { 0 } else { times.count } {
            let world = |node: usize| times.of(node).get(i).map_or(worlds[node], |sample| sample.world);
            let weights = key.weights_over_time.get(i).unwrap_or(&key.weights).iter().map(|bits| f32::from_bits(*bits));
            forms.push((weights.collect(), self.joints(key, &world)?));
        }
        Ok(forms)
    }

    /// Joint matrices of an object's skin, given every node's world transform; `None` without a skin.
    fn joints(&mut self, key: &ObjectKey, worlds: &dyn Fn(usize) -> DAffine3) -> Result<Option<Vec<DMat4>>> {
        let Some(skin) = key.skin else { return Ok(None) };
        joint_matrices(self.document.skins.get(skin)?, &mut self.reader, worlds).map(Some)
    }

    /// Transforms of a placement at the time samples.
    fn placement_times(&self, placement: &Placement, notes: &mut Notes) -> PlacementTimes {
        let transforms = placement.transforms_at(self.times);
        let own = placement.world.as_affine3a();
        let still = |transforms: &[DAffine3]| transforms.iter().all(|world| world.as_affine3a() == own);
        let (shutter, adjacent_frames) = transforms.split_at(self.times.shutter.min(transforms.len()));
        let solid = shutter.iter().all(is_visible);
        if !solid && !still(shutter) {
            let text = "zero or infinite scale while the shutter is open: rendered without motion, as at the picture's own time";
            notes.approximated(&placement.at, text);
        }
        let adjacent_frames = <[DAffine3; 2]>::try_from(adjacent_frames).ok();
        ((solid && !still(shutter)).then(|| shutter.to_vec()), adjacent_frames.filter(|both| !still(both)))
    }

    /// Reads an object's meshes, each with the index of its primitive; in world space if there is a `single` placement; without
    /// what is a line as seen along `lost`.
    fn read(
        &mut self,
        mesh: &MeshOfDocument,
        poses: &MeshPoses,
        (single, lost): (Option<SinglePlacement>, Option<DVec3>),
        notes: &mut Notes,
    ) -> Result<Vec<(usize, Draft)>> {
        let document = self.document;
        let mut drafts: Vec<(usize, Draft)> = Vec::new();
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            note_extensions(&primitive.at, &primitive.extensions, notes);
            // Points and lines are not rendered; reading them notes it.
            if primitive.mode < 4 {
                primitive::read(&mut self.reader, primitive, (&scene::Material::default(), false), poses, notes)?;
                continue;
            }
            let material = self.materials.get(document, primitive.material, &mut self.textures, notes)?;
            let shading = &self.materials.materials[material as usize];
            let shading = (shading, self.fades(primitive));
            if let Some(mut geometry) = primitive::read(&mut self.reader, primitive, shading, poses, notes)? {
                lost.into_iter().for_each(|lost| geometry.drop_edge_on(lost));
                if geometry.mesh.indices.is_empty() {
                    notes.not_loaded(&primitive.at, "a primitive that its scale flattens to lines: nothing to see");
                    continue;
                }
                geometry.mesh.name = match mesh.primitives.len() {
                    1 => mesh.name.clone(),
                    _ => format!("{}[{i}]", mesh.name),
                };
                geometry.mesh.material = material;
                drafts.push((i, Draft { geometry, world: None }));
            }
        }
        if let Some((placement, adjacent_frames)) = single {
            let corners = corners(points(drafts.iter().map(|(_, draft)| &draft.geometry.mesh)));
            check_extent(&corners, &placement.world, &placement.at, &mesh.at)?;
            let thick = |world: DAffine3| thickened(&world, &corners);
            let world = (thick(placement.world), adjacent_frames.map(|both| both.map(thick)));
            drafts.iter_mut().for_each(|(_, draft)| draft.world = Some(world));
        }
        Ok(drafts)
    }

    /// Adds an object's meshes to the scene: from the previous import if it had the same, else read by [`Self::read`].
    fn read_cached(
        &mut self,
        key: &ObjectKey,
        mesh: &MeshOfDocument,
        poses: &MeshPoses,
        (single, lost): (Option<SinglePlacement>, Option<DVec3>),
        notes: &mut Notes,
    ) -> Result<()> {
        let document = self.document;
        let joints = [&poses.picture]
            .into_iter()
            .chain(poses.shutter)
            .chain(poses.adjacent_frames)
            .filter_map(|pose| pose.joints);
        let worlds = single.iter().flat_map(|(placement, adjacent_frames)| {
            [placement.world].into_iter().chain(adjacent_frames.iter().flatten().copied())
        });
        let key = CacheKey::new(key, joints, worlds, (self.times.shutter, lost));
        // Materials are numbered independently of the cache.
        let (mut materials, mut needs) = (Vec::new(), Vec::new());
        for primitive in &mesh.primitives {
            if primitive.mode < 4 {
                materials.push(0);
                continue;
            }
            let material = self.materials.get(document, primitive.material, &mut self.textures, notes)?;
            needs.push(attribute_needs((&self.materials.materials[material as usize], self.fades(primitive))));
            materials.push(material);
        }
        let previous = self.reuse.as_ref().and_then(|reuse| reuse.previous.get(&key));
        let object = match previous.filter(|object| object.needs == needs) {
            Some(object) => Arc::clone(object),
            None => {
                self.reader.unpack(mesh.primitives.iter())?;
                let mut own = Notes::default();
                let read = self.read(mesh, poses, (single, lost), &mut own)?;
                let meshes = read.into_par_iter().map(|(i, draft)| (i, Arc::new(draft.finish()))).collect();
                Arc::new(CachedObject { needs, meshes, notes: own.into_list() })
            }
        };
        object.notes.iter().for_each(|note| notes.add(note.kind, &note.at, note.text.clone()));
        for (primitive, kept) in &object.meshes {
            let mut kept = Arc::clone(kept);
            if kept.material != materials[*primitive] {
                Arc::make_mut(&mut kept).material = materials[*primitive];
            }
            self.scene.meshes.push(kept);
        }
        if let Some(reuse) = &mut self.reuse {
            reuse.current.insert(key, object);
        }
        Ok(())
    }
}
