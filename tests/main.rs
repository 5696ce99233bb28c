//! All tests of the library and the program from outside, in one binary: it links once. `cargo test NAME` runs those
//! whose path holds NAME, as in `cargo test resume::`.

mod glass;
mod helpers;
mod oracle;

// Tests begin in the order of their names: the longest, which mostly waits, before all others.
#[path = "slurm.rs"]
mod a_slurm_of_two_nodes;

mod adaptive;
mod aovs;
mod arrays;
mod back_faces;
mod batch;
mod bits;
mod bsdf;
mod check;
mod cli;
mod closed_forms;
mod corpus;
mod damaged;
mod docs;
mod environments;
mod farm;
mod fireflies;
mod first_picture;
mod flip;
mod glass_shadows;
mod ground;
mod guiding;
mod import;
mod import_animation;
mod import_content;
mod import_hostile;
mod import_notes;
mod import_packed;
mod import_reach;
mod import_repaired;
mod imports_point_one_way;
mod in_ci;
mod labels;
mod lamps;
mod lens;
mod light_groups;
mod lights;
mod limits;
mod look;
mod media;
mod memory;
mod merge;
mod motion;
mod mutations;
mod one_mean;
mod openjd;
mod path_events;
mod path_reuse;
mod paths;
mod pictures;
mod rays;
mod reliability;
mod resume;
mod sampling;
mod scalar;
mod scenes;
mod sequences;
mod sized_lights;
mod sky;
mod techniques;
mod thin_walls;
mod trust;
mod views;
