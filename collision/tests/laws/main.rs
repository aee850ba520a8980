//! Laws of the collision crate: distance fields against closed forms and brute force, contacts and interpolation checks
//! against dense sampling, forces against conservation.

mod ccd;
mod clearance;
mod closed_forms;
mod contact;
mod deforming;
mod forces;
mod grid;
mod interpolation_check;
mod mesh_bake;
mod meshes;
mod random;
mod segments;
mod solids;
