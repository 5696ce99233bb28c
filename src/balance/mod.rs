//! MIS weights and the per-pixel balance: pure mathematics, knows no scene.
