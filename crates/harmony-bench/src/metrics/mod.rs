//! Metrics of reconstructed geometry and pictures.
