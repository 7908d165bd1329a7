//! Translation of simulated scans into real ones, learned from scans of both that have nothing to do with each other: CLS2R, and what
//! it is compared with.

pub mod answer;
pub mod augment;
pub mod config;
pub mod domain;
pub mod exam;
pub mod examiner;
pub mod game;
pub(crate) mod judge;
pub mod learner;
pub mod losses;
pub mod method;
pub mod pool;
pub mod realness;
pub mod sampler;
pub mod schedule;
mod student;
pub mod table;
pub mod training;
pub mod translator;
pub mod twins;
pub mod view;

pub use answer::Reporting;
pub use config::{Method, TranslationConfig};
pub use domain::Domain;
pub use sampler::{Pair, Sampler};
pub use training::{TranslationScores, best_network, train};
pub use translator::Translator;
pub use view::{Coding, Unreported, View};
