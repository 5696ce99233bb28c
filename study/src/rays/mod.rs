//! Embree against obvhs: how fast, how large, how soon, and do they agree?
//!
//! Every contender is measured in turn with the baseline, `embree` as the renderer uses it: the two take turns on the same
//! recorded rays, round by round, so that whatever else the machine does meets both, and their ratio is what is
//! reported. Only two acceleration structures are ever in memory. Seconds are processor seconds of one thread unless stated
//! otherwise: another program on the same cores does not count (but its use of caches and memory
//! does). The control `embree (again)` is the baseline built a second time: its true ratio is 1.

pub mod agree;
pub mod contender;
pub mod exact;
pub mod host;
pub mod measure;
pub mod page;
pub mod replay;
pub mod shapes;
pub mod stream;
pub mod table;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bismar::scene::Scene;
use bismar::{Error, Result};

use crate::balance::scene::Files;

pub use contender::Contender;
pub use host::Bench;
pub use measure::measure;
pub use page::write;
pub use shapes::Shape;
pub use table::Results;

/// Built triangles above which a study takes fewer contenders, unless they were chosen.
pub const LARGE: u64 = 4_000_000;

#[derive(Debug, Clone)]
pub struct Design {
    pub folder: PathBuf,
    pub contenders: Vec<Contender>,
    /// Contenders for scenes with more than [`LARGE`] built triangles.
    pub contenders_large: Vec<Contender>,
    /// Instruction set that Embree is held to.
    pub isa: Option<&'static str>,
    /// About how many rays a stream has.
    pub rays: usize,
    /// Rounds in which contender and baseline take turns, ≥ 3.
    pub rounds: usize,
    /// Pixels a row and column of the pictures.
    pub picture: u32,
    /// Paths a pixel of the pictures, ≥ 2; 0 for no pictures.
    pub spp: u32,
}

impl Design {
    pub fn contenders(&self, subject: &Subject) -> &[Contender] {
        if subject.built > LARGE { &self.contenders_large } else { &self.contenders }
    }
}

/// A scene to be measured on.
pub struct Subject {
    /// Unique name: the file's stem, or the name of the shape.
    pub name: String,
    /// The kind of a generated scene.
    pub shape: Option<&'static str>,
    pub scene: Arc<Scene>,
    /// Triangles, each as often as it is placed.
    pub triangles: u64,
    /// Triangles that are built: each once, or once for every object that is placed.
    pub built: u64,
}

impl Subject {
    /// Reads a file ([`Files`]) as `name`.
    pub fn load(path: &Path, name: &str) -> Result<Self> {
        let subject = Self::new(name.to_owned(), None, Files::open(path)?.import()?);
        if subject.triangles == 0 {
            return Err(Error::Data(format!("{}: there are no triangles to shoot rays at", path.display())));
        }
        Ok(subject)
    }

    pub fn generate(shape: &Shape) -> Self {
        Self::new(shape.name(), Some(shape.kind()), shape.scene())
    }

    pub fn new(name: String, shape: Option<&'static str>, scene: Scene) -> Self {
        let triangles = scene.instances.iter().map(|i| scene.triangles(i.object) as u64).sum();
        let mut seen = vec![false; scene.objects.len()];
        let of_instance = |i: &bismar::scene::Instance| {
            let again = i.transform.is_some() && std::mem::replace(&mut seen[i.object as usize], true);
            if again { 0 } else { scene.triangles(i.object) as u64 }
        };
        let built = scene.instances.iter().map(of_instance).sum();
        Self { name, shape, scene: Arc::new(scene), triangles, built }
    }
}
