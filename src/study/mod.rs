//! Measurements of the program by itself: what each choice costs and what it is worth, with how sure that is.

pub mod balance;
pub mod rays;
pub mod stability;
