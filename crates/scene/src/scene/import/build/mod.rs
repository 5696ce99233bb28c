//! Puts the scene together from a checked document.

mod cache;
mod cameras;
mod count;
mod decode;
mod deform;
mod geometry;
mod lights;
mod materials;
mod nodes;
mod placing;
mod pose;
mod reader;
mod skins;
mod tangents;
mod textures;
mod time_samples;
mod unshown;

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DMat4, DVec3};
use rayon::prelude::*;
use tracing::debug;

use crate::error::Result;
use crate::scene::import::document::Document;
use crate::scene::import::document::extensions::{Support, support};
use crate::scene::import::document::primitives::Mesh as MeshOfDocument;
use crate::scene::import::report::{ImportReport, Notes};
use crate::scene::{self, Instance, Motion, Object, Scene};

pub use cache::Kept;
use cache::{KeptObject, Key, Objects, needs};
use count::count;
pub use count::{image_bytes, mesh_bytes};
use deform::{Pose, Poses};
use geometry::Draft;
use materials::MaterialTable;
use nodes::{ObjectKey, Placement, Walk, walk};
use placing::{check_near, corners, framed, is_invertible, is_solid, points, to_single};
pub use pose::posed;
use reader::Reader;
use textures::TextureTable;
pub use time_samples::{TimeSample, time_sample, time_samples};
use unshown::{note_document, note_faults, note_unplaced};

/// What is shown.
pub struct Shown<'a> {
    /// At the picture's own time sample.
    pub document: &'a Document,
    /// Is that one of its animations?
    pub posed: bool,
    /// While the shutter is open, and a frame before and after; either may be none.
    pub time_samples: &'a [TimeSample],
    /// How many of them are while the shutter is open.
    pub open: usize,
}

/// Builds the scene with what `kept` has of its other poses, adds to the document's notes, and fills the report's
/// extensions, notes and counts.
pub fn build(
    &Shown { document, posed, time_samples, open }: &Shown,
    file_bytes: u64,
    kept: &Kept,
    mut notes: Notes,
    report: &mut ImportReport,
) -> Result<Scene> {
    note_document(document, document.variant.is_some(), posed, &mut notes);
    let reader = Reader::new(document, file_bytes);
    let textures = TextureTable::new(file_bytes);
    let mut assembly = Assembly {
        document,
        time_samples,
        open,
        reader,
        textures,
        materials: MaterialTable::default(),
        scene: Scene::default(),
        seen: Vec::new(),
        drafts: Vec::new(),
        // At rest there are no other time samples.
        sharing: posed.then(|| Sharing { before: kept.objects(), now: Objects::default() }),
    };
    let walk = walk(document, (time_samples, open), &mut assembly.reader, &mut notes)?;
    // What is kept need not be unpacked; where it is another pose that is kept, it is unpacked when it is asked for.
    let known = |mesh: usize| assembly.sharing.as_ref().is_some_and(|s| s.before.keys().any(|key| key.is_of(mesh)));
    let meshes = walk.objects.iter().filter(|(key, _)| !known(key.mesh));
    let meshes = meshes.filter_map(|(key, _)| document.meshes.get(key.mesh).ok());
    let start = Instant::now();
    assembly.reader.unpack(meshes.flat_map(|mesh| &mesh.primitives))?;
    debug!("geometry unpacked: {:.3} s", start.elapsed().as_secs_f64());
    for (key, placements) in &walk.objects {
        assembly.place(key, placements, &walk, &mut notes)?;
    }
    let placed: HashSet<usize> = walk.objects.iter().map(|(key, _)| key.mesh).collect();
    note_unplaced(document, &placed, &mut notes);

    let Assembly { textures, materials, mut scene, seen, drafts, sharing, .. } = assembly;
    let start = Instant::now();
    let finished: Vec<_> = drafts.into_par_iter().map(|(i, draft)| (i, Arc::new(draft.finish()))).collect();
    finished.into_iter().for_each(|(i, mesh)| scene.meshes[i] = mesh);
    debug!("tangents made: {:.3} s", start.elapsed().as_secs_f64());
    let framing = walk.cameras.is_empty().then(|| Box::new(framed(&scene, &seen)));
    if let Some(sharing) = sharing {
        kept.keep(sharing.now);
    }
    note_faults(document, scene.instances.is_empty(), &mut notes)?;
    materials.note_unused(document, &mut notes);
    textures.note_unused(document, &mut notes);
    scene.materials = materials.materials;
    textures.decode(document, file_bytes, kept, &mut scene, &mut notes)?;
    scene.lights = walk.lights;
    scene.cameras = walk.cameras;
    // Until a picture's size is known, for a square one.
    scene.cameras.extend(framing.as_ref().map(|framing| framing.camera(1.0)));
    scene.framing = framing;
    report.counts = count(&scene);
    for name in document.extensions.keys().cloned() {
        match support(&name) {
            Support::Full | Support::NoEffect => report.extensions_used.push(name),
            Support::Ignored(_) => report.extensions_ignored.push(name),
        }
    }
    report.scenes.clone_from(&document.scene_names);
    report.variants.clone_from(&document.variants);
    report.notes = notes.into_list();
    Ok(scene)
}

struct Assembly<'a> {
    document: &'a Document,
    time_samples: &'a [TimeSample],
    /// How many of them are while the shutter is open.
    open: usize,
    reader: Reader<'a>,
    textures: TextureTable,
    materials: MaterialTable,
    scene: Scene,
    /// Of a scene without a camera: objects, in world space for good or not, and where they are.
    seen: Vec<(u32, bool, Vec<DAffine3>)>,
    /// What takes long to finish, with the number of the mesh that stands for it in the scene.
    drafts: Vec<(usize, Draft)>,
    sharing: Option<Sharing>,
}

/// Weights of morph targets, and joints.
type Form = (Vec<f32>, Option<Vec<DMat4>>);

/// What is placed once and still, and where it is a frame before and after if that is elsewhere.
type Once<'a> = (&'a Placement, Option<[DAffine3; 2]>);

/// Where a placement is.
struct Way {
    /// While the shutter is open; `None` if it is still.
    open: Option<Vec<DAffine3>>,
    /// A frame before and after; `None` if that is where it is.
    adjacent_frames: Option<[DAffine3; 2]>,
}

/// Objects of another time sample, and of this one.
struct Sharing {
    before: Objects,
    now: Objects,
}

impl Assembly<'_> {
    /// Reads an object's meshes and places them.
    fn place(&mut self, key: &ObjectKey, placements: &[Placement], walk: &Walk, notes: &mut Notes) -> Result<()> {
        let document = self.document;
        let placements: Vec<&Placement> = placements.iter().filter(|p| is_solid(p, notes)).collect();
        let mesh = document.meshes.get(key.mesh)?;
        let joints = match key.skin {
            Some(skin) => Some(skins::joint_matrices(document.skins.get(skin)?, &mut self.reader, &walk.worlds)?),
            None => None,
        };
        let start = self.scene.meshes.len() as u32;
        if placements.is_empty() {
            return Ok(());
        }
        let floats = |bits: &[u32]| bits.iter().map(|bits| f32::from_bits(*bits)).collect::<Vec<_>>();
        let weights = floats(&key.weights);
        let forms = self.forms(key)?;
        let forms: Vec<Pose> = forms.iter().map(|(w, joints)| Pose { weights: w, joints: joints.as_deref() }).collect();
        let own = Pose { weights: &weights, joints: joints.as_deref() };
        let changing = |forms: &[Pose]| forms.iter().any(|form| *form != own);
        let [over, adjacent_frames] =
            [&forms[..self.open], &forms[self.open..]].map(|f| if changing(f) { f } else { &[] });
        let poses = Poses { own, over, adjacent_frames };
        let ways = placements.iter().map(|placement| self.way(placement, notes)).collect::<Vec<_>>();
        // Into world space for good, if it is there but once, and still.
        let once = if let ([placement], [Way { open: None, .. }]) = (&placements[..], &ways[..]) {
            Some((*placement, ways[0].adjacent_frames))
        } else {
            None
        };
        if self.sharing.is_some() {
            self.share(key, mesh, &poses, once, notes)?;
        } else {
            for (_, draft) in self.read(mesh, &poses, once, notes)? {
                if draft.takes_long() {
                    let outline = Arc::new(draft.outline());
                    self.drafts.push((self.scene.meshes.len(), draft));
                    self.scene.meshes.push(outline);
                } else {
                    self.scene.meshes.push(Arc::new(draft.finish()));
                }
            }
        }
        let meshes = start..self.scene.meshes.len() as u32;
        if meshes.is_empty() {
            return Ok(());
        }
        let object = self.scene.objects.len() as u32;
        self.scene.objects.push(Object { name: mesh.name.clone(), meshes: meshes.clone() });
        let own = self.scene.meshes[meshes.start as usize..].iter().map(Arc::as_ref);
        if walk.cameras.is_empty() {
            self.seen.push((object, once.is_some(), placements.iter().map(|placement| placement.world).collect()));
        }
        if let Some((placement, _)) = once {
            self.scene.instances.push(Instance { name: placement.name.clone(), object, ..Default::default() });
            return Ok(());
        }
        let corners = corners(points(own));
        for (placement, way) in placements.iter().zip(ways) {
            for world in [&placement.world].into_iter().chain(way.open.iter().flatten()) {
                check_near(&corners, world, &placement.at, &mesh.at)?;
            }
            let motion = way.open.and_then(|way| Motion::new(&way)).map(Arc::new);
            let (transform, adjacent_frames) =
                (Some(to_single(&placement.world)), way.adjacent_frames.map(|b| b.map(|w| to_single(&w))));
            self.scene.instances.push(Instance {
                name: placement.name.clone(),
                object,
                transform,
                motion,
                adjacent_frames,
            });
        }
        Ok(())
    }

    /// Weights and joints at each time sample.
    fn forms(&mut self, key: &ObjectKey) -> Result<Vec<Form>> {
        let mut forms = Vec::new();
        for (i, time_sample) in self.time_samples.iter().enumerate() {
            let weights = key.moving.get(i).unwrap_or(&key.weights).iter().map(|bits| f32::from_bits(*bits));
            let joints = match key.skin.map(|skin| self.document.skins.get(skin)).transpose()? {
                Some(skin) => Some(skins::joint_matrices(skin, &mut self.reader, &time_sample.matrices())?),
                None => None,
            };
            forms.push((weights.collect(), joints));
        }
        Ok(forms)
    }

    /// Where a placement is at other time samples.
    fn way(&self, placement: &Placement, notes: &mut Notes) -> Way {
        let way = placement.way(self.time_samples);
        let still = |way: &[DAffine3]| way.iter().all(|world| to_single(world) == to_single(&placement.world));
        let (open, adjacent_frames) = way.split_at(self.open.min(way.len()));
        let solid = open.iter().all(is_invertible);
        if !solid {
            let text =
                "of zero or infinite scale while the shutter is open: it stands still as at the picture's time_sample";
            notes.approximated(&placement.at, text);
        }
        Way {
            open: (solid && !still(open)).then(|| open.to_vec()),
            adjacent_frames: adjacent_frames
                .try_into()
                .ok()
                .filter(|adjacent_frames: &[DAffine3; 2]| !still(adjacent_frames)),
        }
    }

    /// Reads an object's meshes, each with the number of its primitive; those of one that is placed once, for world space.
    fn read(
        &mut self,
        mesh: &MeshOfDocument,
        poses: &Poses,
        once: Option<Once>,
        notes: &mut Notes,
    ) -> Result<Vec<(usize, Draft)>> {
        let document = self.document;
        let mut drafts: Vec<(usize, Draft)> = Vec::new();
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            for name in &primitive.extensions {
                if let Support::Ignored(why) = support(name) {
                    notes.ignored(&format!("{}.extensions.{name}", primitive.at), format!("{name}: {why}"));
                }
            }
            // Points and lines use no material of ours.
            if primitive.mode < 4 {
                geometry::read(&mut self.reader, primitive, &scene::Material::default(), poses, notes)?;
                continue;
            }
            let material = self.materials.get(document, primitive.material, &mut self.textures, notes)?;
            let shading = &self.materials.materials[material as usize];
            if let Some(geometry) = geometry::read(&mut self.reader, primitive, shading, poses, notes)? {
                let name = match mesh.primitives.len() {
                    1 => mesh.name.clone(),
                    _ => format!("{}[{i}]", mesh.name),
                };
                let world = once.map(|(placement, adjacent_frames)| (placement.world, adjacent_frames));
                drafts.push((i, Draft { geometry, name, material, world }));
            }
        }
        if let Some((placement, _)) = once {
            let positions = drafts.iter().flat_map(|(_, draft)| &draft.geometry.positions);
            let corners = corners(positions.map(|p| DVec3::from(p.map(f64::from))));
            check_near(&corners, &placement.world, &placement.at, &mesh.at)?;
        }
        Ok(drafts)
    }

    /// As [`Self::read`], into the scene; what another time sample of the files has is taken from there.
    fn share(
        &mut self,
        key: &ObjectKey,
        mesh: &MeshOfDocument,
        poses: &Poses,
        once: Option<Once>,
        notes: &mut Notes,
    ) -> Result<()> {
        let document = self.document;
        let joints =
            [&poses.own].into_iter().chain(poses.over).chain(poses.adjacent_frames).filter_map(|pose| pose.joints);
        let worlds = once.iter().flat_map(|(placement, adjacent_frames)| {
            [placement.world].into_iter().chain(adjacent_frames.iter().flatten().copied())
        });
        let key = Key::new(key, joints, worlds, self.open);
        // Materials are numbered as if nothing were shared.
        let (mut materials, mut asked) = (Vec::new(), Vec::new());
        for primitive in &mesh.primitives {
            if primitive.mode < 4 {
                materials.push(0);
                continue;
            }
            let material = self.materials.get(document, primitive.material, &mut self.textures, notes)?;
            asked.push(needs(&self.materials.materials[material as usize]));
            materials.push(material);
        }
        let before = self.sharing.as_ref().and_then(|sharing| sharing.before.get(&key));
        let object = match before.filter(|object| object.needs == asked) {
            Some(object) => Arc::clone(object),
            None => {
                self.reader.unpack(mesh.primitives.iter())?;
                let mut own = Notes::default();
                let read = self.read(mesh, poses, once, &mut own)?;
                let meshes = read.into_par_iter().map(|(i, draft)| (i, Arc::new(draft.finish()))).collect();
                Arc::new(KeptObject { needs: asked, meshes, notes: own.into_list() })
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
        if let Some(sharing) = &mut self.sharing {
            sharing.now.insert(key, object);
        }
        Ok(())
    }
}
