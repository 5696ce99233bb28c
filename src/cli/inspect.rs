//! `bismar inspect SCENE`

use std::path::PathBuf;

use clap::Args;

use super::{Verdict, print_json};
use crate::Result;
use crate::scene::import::{self, ImportOptions};

/// Say what a scene holds, and what of it is used, approximated and left out.
#[derive(Debug, Args)]
pub struct InspectArgs {
    /// The scene, .gltf or .glb.
    scene: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &InspectArgs) -> Result<Verdict> {
    let imported = import::import(&args.scene, &ImportOptions { strict: false })?;
    let _ = args.json;
    print_json(&import::summary(&imported))?;
    Ok(Verdict::Done)
}
