//! Position between edges and velocity from edge time-stamps.
