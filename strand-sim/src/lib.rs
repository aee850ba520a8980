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
//! let report = system.step(&mut state, &StepInput::still(0.01, head), &params, &mut StepWorkspace::default());
//! assert_eq!(report.quarantined, 0);
//! # Ok::<(), strand_sim::Error>(())
//! ```

pub mod altitude;
mod bearing;
mod body_contact;
mod cut_force;
mod drive;
mod error;
mod forces;
mod implicit;
pub mod interaction;
pub mod lanes;
mod material;
pub mod network;
pub mod reference;
mod rest;
pub mod rig;
pub mod scalp;
pub mod solve;
mod step;
mod step_size;
pub mod stiffness;
mod strain_limit;
mod surface_contact;
mod system;
mod watch;
pub mod wind;

pub use body_contact::{Contact, ContactParams, NearPoint, near_points, near_points_in};
pub use drive::{Drive, RootMotion};
pub use error::Error;
pub use material::{ALTITUDE_PER_TWIST, Material};
pub use rest::RestReport;
pub use scalp::Scalp;
pub use step::interacting::{InteractionParams, InteractionReport, InteractionWorkspace};
pub use step::{Scheme, StepInput, StepParams, StepReport, StepWorkspace};
pub use step_size::Substeps;
pub use system::{MIN_LENGTH_CM, StrandState, StrandSystem};
