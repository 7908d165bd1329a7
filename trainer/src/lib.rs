//! Learns what a real sensor makes of a scan: networks, losses, training, evaluation, export.

pub mod backend;
pub mod benchmark;
pub mod birds_eye;
pub mod closed_loop;
pub mod config;
pub mod data;
pub mod drop_bursts;
pub mod effects;
pub mod evaluate;
pub mod export;
pub mod exported;
pub mod generator;
pub mod loss;
pub mod network;
pub mod realness;
pub mod scatter;
mod seeds;
pub mod segmentation;
pub mod sensor_report;
pub mod sets;
pub mod simulate;
pub mod train;
pub mod translation;
