//! HOSTUNITS 280 against libbarrett's arithmetic: a radian, a rad/s and a N·m of the joint are the same for host and board.

use std::f64::consts::PI;

use tater_wire::property::host_units::{to_board, to_host};
use tater_wire::{MotorKind, Property};

const KINDS: [MotorKind; 3] = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];

/// libbarrett's ratio of a joint.
const fn ratio(kind: MotorKind) -> f64 {
    match kind {
        MotorKind::Spread => 17.5,
        MotorKind::Link | MotorKind::Tip => 125.0,
    }
}

/// Encoder counts a radian of the joint, as libbarrett and cisst compute them from CTS.
fn counts_per_rad(kind: MotorKind) -> f64 {
    let cts = to_host(Property::CTS, kind, MotorKind::COUNTS_PER_TURN);
    ratio(kind) * cts as f64 / (2.0 * PI)
}

/// Hall counts a radian of the joint (manual 1.3.2, table 2).
fn halls_per_rad(kind: MotorKind) -> f64 {
    kind.gear_hundredths() as f64 / 100.0 * 18.0 / (2.0 * PI)
}

#[test]
fn radians_of_libbarretts_joints_are_radians_of_these() {
    for kind in KINDS {
        for rad in [0.01, 0.05, 0.5, 1.0, 2.4, PI, -0.17] {
            let asked = (counts_per_rad(kind) * rad) as i64;
            for property in [Property::P, Property::E, Property::M, Property::CT, Property::OT] {
                let halls = to_board(property, kind, asked) as f64;
                assert!((halls - halls_per_rad(kind) * rad).abs() <= 0.51, "{kind:?}: {rad} rad, {halls}");
            }
            let read = to_host(Property::P, kind, (halls_per_rad(kind) * rad).round() as i64);
            let error = read as f64 / counts_per_rad(kind) - rad;
            assert!(error.abs() <= 0.51 / halls_per_rad(kind), "{kind:?}: {rad} rad reads {error} off");
        }
    }
}

#[test]
fn counts_per_ms_are_the_same_speed_of_the_joint() {
    for kind in KINDS {
        for theirs in [-200, -75, -40, -1, 0, 1, 5, 40, 200, 1000] {
            let rad_per_s = 1000.0 * theirs as f64 / counts_per_rad(kind);
            let ours = to_board(Property::V, kind, theirs) as f64;
            // Half a count/s is the resolution of V here.
            assert!(
                (ours / halls_per_rad(kind) - rad_per_s).abs() <= 0.51 / halls_per_rad(kind),
                "{kind:?} {theirs}"
            );
        }
    }
    assert_eq!(to_board(Property::V, MotorKind::Link, 40), 69, "libbarrett's 0.5 rad/s, cut to 40 counts/ms");
}

/// libbarrett sends joint torque · IPNM / ratio. Half a unit of T, 1/1575 N·m at the motor, is the resolution here: 0.016 N·m
/// at a finger's joint.
#[test]
fn torques_press_as_hard_at_the_joint() {
    for kind in KINDS {
        let ipnm = to_host(Property::IPNM, kind, Property::IPNM.rules().max());
        assert_eq!(ipnm, 20_000);
        for n_m in [-5.0, -0.5, 0.1, 0.5, 1.0, 8.0] {
            let asked = (n_m * ipnm as f64 / ratio(kind)) as i64;
            let ours = to_board(Property::T, kind, asked) as f64;
            let gear = kind.gear_hundredths() as f64 / 100.0;
            let delivered = ours / 1575.0 * gear;
            // And less than a unit of theirs, which the host cuts off.
            let error = 0.51 * gear / 1575.0 + ratio(kind) / 20_000.0;
            assert!((delivered - n_m).abs() <= error, "{kind:?}: {n_m} N m asked, {delivered} delivered");
        }
    }
}

/// 1/256 count/ms² against (ACCEL/1024)² hall counts/ms².
#[test]
fn accelerations_of_the_joint_agree() {
    for kind in KINDS {
        for theirs in [20, 100, 200, 1000] {
            let rad_per_s2 = theirs as f64 / 256.0 * 1e6 / counts_per_rad(kind);
            let ours = to_board(Property::ACCEL, kind, theirs) as f64;
            let given = (ours / 1024.0).powi(2) * 1e6 / halls_per_rad(kind);
            // Half a unit of ACCEL.
            assert!((given / rad_per_s2 - 1.0).abs() <= 1.05 / ours, "{kind:?}: ACCEL {theirs} is {ours}");
        }
    }
    assert_eq!(
        to_board(Property::ACCEL, MotorKind::Link, 200),
        38,
        "Barrett's default is about this hand's, 40"
    );
}
