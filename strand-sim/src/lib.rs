//! Mass-spring dynamics of a set of hair strands, after Selle, Lentine, Fedkiw, *A Mass Spring Model for Hair Simulation*
//! (MS08).
//!
//! The crate steps whatever strands it is given, under gravity, given forces and contact with solids; it has no notion of
//! guide or normal hair. Units are centimetre, gram, second.
//!
//! ```
//! use nalgebra::{Isometry3, Vector3};
//! use strand_sim::{Material, StepInput, StepParams, StepWorkspace, StrandSystem};
//!
//! let points: Vec<_> = (0..25).map(|i| Vector3::new(0.0, -f64::from(i), 0.0)).collect();
//! let system = StrandSystem::new(&points, 25, Material::straight())?;
//! let params = StepParams::standard();
//! let head = Isometry3::identity();
//! let mut state = system.rest_state(&head);
//! let input =
//!     StepInput { dt: 0.01, world_from_head_before: head, world_from_head_after: head, solids: &[], forces: &[] };
//! let report = system.step(&mut state, &input, &params, &mut StepWorkspace::default());
//! assert_eq!(report.quarantined, 0);
//! # Ok::<(), strand_sim::Error>(())
//! ```

mod body_contact;
mod error;
mod forces;
pub mod interaction;
pub mod lanes;
mod material;
pub mod rig;
pub mod solve;
mod step;
mod strain_limit;
mod system;

pub use body_contact::{Contact, ContactParams, NearPoint, near_points};
pub use error::Error;
pub use material::Material;
pub use step::{StepInput, StepParams, StepReport, StepWorkspace};
pub use system::{MIN_LENGTH_CM, StrandState, StrandSystem};
