//! Puts the scene together from a checked document.

mod cameras;
mod decode;
mod geometry;
mod kept;
mod lights;
mod materials;
mod nodes;
mod pose;
mod reader;
mod skins;
mod tangents;
mod textures;

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, DAffine3, DVec3};
use tracing::debug;

use crate::error::{Error, Result};
use crate::scene::import::document::Document;
use crate::scene::import::document::extensions::{Support, support};
use crate::scene::import::document::primitives::Mesh as MeshOfDocument;
use crate::scene::import::report::{ImportReport, Notes, SceneCounts};
use crate::scene::{self, FARTHEST, Framing, Instance, Mesh, Object, Scene, Texels};

use geometry::Pose;
pub use kept::Kept;
use kept::{KeptObject, Key, Objects, needs};
use materials::MaterialTable;
use nodes::{ObjectKey, Placement, Walk, walk};
pub use pose::posed;
use reader::Reader;
use textures::TextureTable;

/// Builds the scene with what `kept` has of its other moments, adds to the document's notes, and fills the report's extensions, notes and counts.
pub fn build(
    document: &Document,
    file_bytes: u64,
    posed: bool,
    kept: &Kept,
    mut notes: Notes,
    report: &mut ImportReport,
) -> Result<Scene> {
    note_document(document, document.variant.is_some(), posed, &mut notes);
    let reader = Reader::new(document, file_bytes);
    let textures = TextureTable::new(file_bytes);
    let mut assembly = Assembly {
        document,
        reader,
        textures,
        materials: MaterialTable::default(),
        scene: Scene::default(),
        framing: None,
        // At rest there are no other moments.
        sharing: posed.then(|| Sharing { before: kept.objects(), now: Objects::default() }),
    };
    let walk = walk(document, &mut assembly.reader, &mut notes)?;
    // What is kept need not be unpacked; where it is another pose that is kept, it is unpacked when it is asked for.
    let known = |mesh: usize| assembly.sharing.as_ref().is_some_and(|s| s.before.keys().any(|key| key.is_of(mesh)));
    let meshes = walk.objects.iter().filter(|(key, _)| !known(key.mesh));
    let meshes = meshes.filter_map(|(key, _)| document.meshes.get(key.mesh).ok());
    let start = Instant::now();
    assembly.reader.unpack(meshes.flat_map(|mesh| &mesh.primitives))?;
    debug!("geometry unpacked: {:.3} s", start.elapsed().as_secs_f64());
    assembly.framing = walk.cameras.is_empty().then(Box::default);
    for (key, placements) in &walk.objects {
        assembly.place(key, placements, &walk, &mut notes)?;
    }
    let placed: HashSet<usize> = walk.objects.iter().map(|(key, _)| key.mesh).collect();
    note_unplaced(document, &placed, &mut notes);

    let Assembly { textures, materials, mut scene, framing, sharing, .. } = assembly;
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

/// What concerns the file as a whole.
fn note_document(document: &Document, variant: bool, posed: bool, notes: &mut Notes) {
    for (name, at) in &document.extensions {
        // Extensions of objects are noted where those are used.
        let whole = !at.contains('.') || at.starts_with("scenes");
        if let Support::Ignored(why) = support(name)
            && whole
            && at != "extensionsUsed"
        {
            notes.ignored(&format!("{at}.{name}"), format!("{name}: {why}"));
        }
    }
    if document.animations.len() > 0 && !posed {
        let text = "animations are not played: the scene is shown at rest (--pose and --frame show other moments)";
        notes.approximated("animations", text);
    }
    if !document.variants.is_empty() && !variant {
        let text = "material variants: the default materials are shown (--variant chooses others)";
        notes.convention("extensions.KHR_materials_variants", text);
    }
    match document.scenes.len() {
        0 => notes.convention("scenes", "no scene in the file: all of its nodes are shown"),
        1 => {}
        n => notes.not_loaded("scenes", format!("{} of {n} scenes: only {} is shown", n - 1, document.scene_at)),
    }
}

struct Assembly<'a> {
    document: &'a Document,
    reader: Reader<'a>,
    textures: TextureTable,
    materials: MaterialTable,
    scene: Scene,
    /// Of a scene without a camera.
    framing: Option<Box<Framing>>,
    sharing: Option<Sharing>,
}

/// Objects of another moment, and of this one.
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
        let weights: Vec<f32> = key.weights.iter().map(|bits| f32::from_bits(*bits)).collect();
        let pose = Pose { weights: &weights, joints: joints.as_deref() };
        let start = self.scene.meshes.len() as u32;
        if placements.is_empty() {
            return Ok(());
        }
        let once = if let [placement] = placements[..] { Some(placement) } else { None };
        if self.sharing.is_some() {
            self.share(key, mesh, &pose, once, notes)?;
        } else {
            let read = self.read(mesh, &pose, once, notes)?;
            self.scene.meshes.extend(read.into_iter().map(|(_, mesh)| Arc::new(mesh)));
        }
        let meshes = start..self.scene.meshes.len() as u32;
        if meshes.is_empty() {
            return Ok(());
        }
        let object = self.scene.objects.len() as u32;
        self.scene.objects.push(Object { name: mesh.name.clone(), meshes: meshes.clone() });
        let own = self.scene.meshes[meshes.start as usize..].iter().map(Arc::as_ref);
        if let Some(placement) = once {
            if let Some(framing) = &mut self.framing {
                points(own).for_each(|p| framing.include(p));
            }
            self.scene.instances.push(Instance { name: placement.name.clone(), object, transform: None });
            return Ok(());
        }
        let corners = corners(own);
        for placement in &placements {
            for p in moved(&corners, placement, &mesh.at)? {
                if let Some(framing) = &mut self.framing {
                    framing.include(p);
                }
            }
            let transform = Some(to_single(&placement.world));
            self.scene.instances.push(Instance { name: placement.name.clone(), object, transform });
        }
        Ok(())
    }

    /// Reads an object's meshes, each with the number of its primitive; those of one that is placed once, into world space.
    fn read(
        &mut self,
        mesh: &MeshOfDocument,
        pose: &Pose,
        once: Option<&Placement>,
        notes: &mut Notes,
    ) -> Result<Vec<(usize, Mesh)>> {
        let document = self.document;
        let mut meshes = Vec::new();
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            for name in &primitive.extensions {
                if let Support::Ignored(why) = support(name) {
                    notes.ignored(&format!("{}.extensions.{name}", primitive.at), format!("{name}: {why}"));
                }
            }
            // Points and lines use no material of ours.
            if primitive.mode < 4 {
                geometry::read(&mut self.reader, primitive, &scene::Material::default(), pose, notes)?;
                continue;
            }
            let material = self.materials.get(document, primitive.material, &mut self.textures, notes)?;
            let shading = &self.materials.materials[material as usize];
            if let Some(geometry) = geometry::read(&mut self.reader, primitive, shading, pose, notes)? {
                let name = match mesh.primitives.len() {
                    1 => mesh.name.clone(),
                    _ => format!("{}[{i}]", mesh.name),
                };
                meshes.push((i, geometry.into_mesh(name, material)));
            }
        }
        if let Some(placement) = once {
            moved(&corners(meshes.iter().map(|(_, mesh)| mesh)), placement, &mesh.at)?;
            meshes.iter_mut().for_each(|(_, mesh)| geometry::bake(mesh, &placement.world));
        }
        Ok(meshes)
    }

    /// As [`Self::read`], into the scene; what another moment of the files has is taken from there.
    fn share(
        &mut self,
        key: &ObjectKey,
        mesh: &MeshOfDocument,
        pose: &Pose,
        once: Option<&Placement>,
        notes: &mut Notes,
    ) -> Result<()> {
        let document = self.document;
        let key = Key::new(key, pose.joints, once.map(|placement| &placement.world));
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
                let read = self.read(mesh, pose, once, &mut own)?;
                let meshes = read.into_iter().map(|(i, mesh)| (i, Arc::new(mesh))).collect();
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

/// Where a placement takes a box's corners.
///
/// # Errors
/// One that takes them, or finds them, too far away.
fn moved(corners: &[DVec3], placement: &Placement, mesh: &str) -> Result<Vec<DVec3>> {
    let moved: Vec<DVec3> = corners.iter().map(|&c| placement.world.transform_point3(c)).collect();
    match corners.iter().chain(&moved).any(|p| p.abs().max_element() > f64::from(FARTHEST)) {
        true => Err(Error::Data(format!(
            "{}: places {mesh} beyond {FARTHEST:e} m, where rays cannot be traced; scale the scene down",
            placement.at
        ))),
        false => Ok(moved),
    }
}

fn note_unplaced(document: &Document, placed: &HashSet<usize>, notes: &mut Notes) {
    for (_, mesh) in document.meshes.sound().filter(|(index, _)| !placed.contains(index)) {
        notes.not_loaded(&mesh.at, "a mesh that no shown node places");
    }
}

/// What is still faulty here is what nothing shown needed. Where nothing is shown at all, that may be why: then the first
/// fault is an error.
fn note_faults(document: &Document, nothing_shown: bool, notes: &mut Notes) -> Result<()> {
    for (at, error) in document.faults() {
        if nothing_shown {
            return Err(error);
        }
        // Pictures that a shown material asks for have their note already.
        notes.not_loaded(&at, format!("faulty, but nothing shown needs it: {error}"));
    }
    Ok(())
}

fn to_single(world: &DAffine3) -> Affine3A {
    world.as_affine3a()
}

/// Drops what a transform makes flat or infinite.
fn is_solid(placement: &Placement, notes: &mut Notes) -> bool {
    let single = to_single(&placement.world);
    let solid = placement.world.matrix3.determinant() != 0.0 && single.is_finite() && single.inverse().is_finite();
    if !solid {
        notes.not_loaded(&placement.at, "a placement with zero or infinite scale: nothing to see");
    }
    solid
}

fn points<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> impl Iterator<Item = DVec3> {
    meshes.flat_map(|m| m.positions.iter()).map(|p| DVec3::from(p.map(f64::from)))
}

/// Corners of the meshes' box.
fn corners<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> Vec<DVec3> {
    let bounds = |b: Option<(DVec3, DVec3)>, p: DVec3| Some(b.map_or((p, p), |(low, high)| (low.min(p), high.max(p))));
    let Some((low, high)) = points(meshes).fold(None, bounds) else { return Vec::new() };
    let pick = |i: u32, axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
    (0..8).map(|i| DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2))).collect()
}

/// Bytes of a mesh's arrays.
pub fn mesh_bytes(mesh: &Mesh) -> u64 {
    fn of<T>(values: Option<&Vec<T>>) -> usize {
        values.map_or(0, |v| size_of_val(v.as_slice()))
    }
    let bytes = size_of_val(&mesh.positions[..])
        + of(Some(&mesh.indices))
        + of(mesh.normals.as_ref())
        + of(mesh.tangents.as_ref())
        + mesh.texcoords.iter().map(|t| of(t.as_ref())).sum::<usize>()
        + of(mesh.colors.as_ref());
    bytes as u64
}

/// Bytes of a picture's texels.
pub fn image_bytes(image: &scene::Image) -> u64 {
    let bytes = match &image.texels {
        Texels::Rgb8(t) => size_of_val(t.as_slice()),
        Texels::Rgba8(t) => size_of_val(t.as_slice()),
        Texels::Rgba16(t) => size_of_val(t.as_slice()),
    };
    bytes as u64
}

fn count(scene: &Scene) -> SceneCounts {
    let triangles = |meshes: &[Arc<Mesh>]| meshes.iter().map(|m| m.indices.len() as u64).sum::<u64>();
    let of_instance = |i: &Instance| {
        let range = &scene.objects[i.object as usize].meshes;
        triangles(&scene.meshes[range.start as usize..range.end as usize])
    };
    SceneCounts {
        triangles: triangles(&scene.meshes),
        instanced_triangles: scene.instances.iter().map(of_instance).sum(),
        meshes: scene.meshes.len() as u64,
        objects: scene.objects.len() as u64,
        instances: scene.instances.len() as u64,
        materials: scene.materials.len() as u64,
        images: scene.images.len() as u64,
        lights: scene.lights.len() as u64,
        cameras: scene.cameras.len() as u64,
        geometry_bytes: scene.meshes.iter().map(|mesh| mesh_bytes(mesh)).sum(),
        image_bytes: scene.images.iter().map(|image| image_bytes(image)).sum(),
    }
}
