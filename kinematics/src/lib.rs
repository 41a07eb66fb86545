//! Kinematics of the hand (manual 8, which has headings only): joint angles from motor counts, fingertips from joint angles and back,
//! Jacobians, and the bodies from which `cargo xtask model` writes URDF and MJCF.
//!
//! `no_std`, no heap. All figures are fields of one struct, [`Hand`], each with its source. It decides no motion and knows no contact: the
//! servo moves joints, a simulator finds what they touch. Lengths are in meters, angles in radians, closing is positive.
//!
//! ```
//! use kinematics::{Finger, Hand};
//!
//! let hand = Hand::default();
//! // Fingers 1 to 3, the spread, tips 1 to 3, as the motors are numbered.
//! let joints = hand.joints([220.5, 220.5, 220.5, 0.0, 0.0, 0.0, 0.0]);
//! let angles = joints.of(Finger::F3);
//! let tip = hand.fingertip(Finger::F3, angles).origin;
//! let back = hand.inverse(Finger::F3, tip)?.nearest(angles);
//! assert!((back.link - angles.link).abs() < 1e-9);
//! # Ok::<(), kinematics::Unreachable>(())
//! ```
//!
//! docs/kinematics.md has the table, the frames and their figure.

#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bodies;
mod finger;
mod hand;
mod inverse;
mod transform;

pub use finger::{DhRow, Jacobian};
pub use hand::{Angles, Drive, Finger, Hand, Joints, MOTORS};
pub use inverse::{Joint, Solutions, Unreachable};
pub use transform::{Transform, Vector};
