//! Laws of hair-hair interaction: stiction, repulsion and collision against conservation, plain references and each other.

mod collide;
mod repulsion;
mod scenes;
mod slices;
mod stiction;
