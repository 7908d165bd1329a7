//! The closed loop: finds what a sensor does that its model lacks, traces it to an effect, adds it, and says what that was worth.

pub mod base;
pub mod black_box;
pub mod calibrate;
pub mod candidate;
pub mod data;
pub mod declared;
pub mod delivery;
pub mod export;
pub mod fit;
pub mod folder;
pub mod ground;
pub mod improve;
pub mod lay;
pub mod likelihood;
pub mod metrics;
pub mod model;
pub mod network;
pub mod newton;
pub mod outcome;
pub mod predicted;
pub mod report;
pub mod resample;
pub mod screen;
pub mod significance;
pub mod split;
pub mod unpaired;
