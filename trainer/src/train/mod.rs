//! Training: one loop, and what learns in it.

pub mod average;
pub mod checkpoint;
pub mod events;
pub mod learner;
pub mod parts;
pub mod run;
pub mod supervised;
mod teach;
pub mod trainee;

pub use learner::{Learner, Losses, Validation};
pub use parts::Parts;
pub use run::Run;
pub use supervised::{best_network, train};
pub use teach::{Ending, Plan, teach};
pub use trainee::Trainee;
