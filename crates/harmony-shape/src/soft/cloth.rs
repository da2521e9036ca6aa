//! The simulation: extended position-based dynamics.
