//! RealTime: control and feedback blocks at a fixed rate.

use std::ffi::{c_char, c_int, c_void};
use std::ops::ControlFlow;
use std::time::Duration;

use wraptor::hand::RATES;
use wraptor::{Control, Feedback, Format};

use crate::border::{deadline, text, with_hand};
use crate::error::{Problem, wraptor_error};
use crate::slot::wraptor_hand;

/// The layout of RealTime's blocks, the same for every motor.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct wraptor_format {
    /// Unit of control velocities, hall counts/s, 1 to 255; 0: no velocity in control blocks.
    pub velocity_unit: u8,
    /// Not 0: a proportional gain in control blocks.
    pub has_gain: u8,
    /// Unit of the velocity fed back, hall counts/s, 1 to 255; 0: none.
    pub feeds_velocity_unit: u8,
    /// Not 0: strain in feedback blocks.
    pub feeds_strain: u8,
    /// Not 0: position in feedback blocks.
    pub feeds_position: u8,
    /// Unit of the change of position fed back, GCL counts, 1 to 255; 0: none.
    pub feeds_change_unit: u8,
    /// Not 0: the hand's temperature in feedback blocks.
    pub feeds_temperature: u8,
}

/// What a motor is to do.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct wraptor_control {
    /// Hall counts/s, positive closes; rounded and clipped to what a byte of the format's unit holds.
    pub velocity: i32,
    /// Proportional gain, if the format has it.
    pub gain: u8,
}

/// What a motor has fed back; 0 for what the format lacks.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct wraptor_axis {
    /// Hall counts/s.
    pub velocity: i32,
    /// Strain, 0 to 255.
    pub strain: i32,
    /// GCL counts.
    pub position: i32,
    /// Change since the last block, GCL counts.
    pub change: i32,
}

/// How regular a run was. Arrays hold the median, the 99th percentile and the maximum.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct wraptor_statistics {
    /// Blocks that were answered.
    pub blocks: u64,
    /// Places of the schedule that were left out, because an answer had taken longer than a period.
    pub missed: u64,
    /// Blocks a second.
    pub rate: f64,
    /// How late blocks were sent against the schedule, ms.
    pub jitter_ms: [f64; 3],
    /// From a block to its whole answer, ms.
    pub round_trip_ms: [f64; 3],
}

/// Called before each block: `block` counts from 0; `axes` has `count` elements with the last feedback, zeros before the first; `temperature` is in °C,
/// 0 if the format lacks it; `controls` has `count` elements, zeros, for what the motors are to do. Returns 0 to end RealTime.
// SAFETY: who passes one promises that it may be called like this.
pub type wraptor_on_block = Option<
    unsafe extern "C" fn(
        context: *mut c_void,
        block: u64,
        axes: *const wraptor_axis,
        count: usize,
        temperature: f64,
        controls: *mut wraptor_control,
    ) -> c_int,
>;

impl wraptor_format {
    fn format(self) -> Format {
        let unit = |unit: u8| (unit != 0).then_some(unit);
        Format {
            velocity: unit(self.velocity_unit),
            gain: self.has_gain != 0,
            feeds_velocity: unit(self.feeds_velocity_unit),
            feeds_strain: self.feeds_strain != 0,
            feeds_position: self.feeds_position != 0,
            feeds_change: unit(self.feeds_change_unit),
            feeds_temperature: self.feeds_temperature != 0,
        }
    }
}

fn axes_of(feedback: &Feedback, count: usize) -> Vec<wraptor_axis> {
    let mut axes = vec![wraptor_axis::default(); count];
    for (to, axis) in axes.iter_mut().zip(&feedback.axes) {
        *to = wraptor_axis {
            velocity: axis.velocity.unwrap_or(0),
            strain: axis.strain.map_or(0, i32::from),
            position: axis.position.unwrap_or(0),
            change: axis.change.unwrap_or(0),
        };
    }
    axes
}

/// Runs RealTime for motors, a prefix of the language such as `124` or `X1234567`, at 1 to 1000 blocks a second, until the callback returns 0. `format`
/// is NULL for velocities of unit 8 in and positions out. `limit_ms` bounds the beginning and the end, `block_limit_ms` each block; the callback
/// decides how long it runs. `statistics` may be NULL.
///
/// Errors: WRAPTOR_STATUS with ERR 4 before `wraptor_find_zero`.
///
/// # Safety
/// `motors` is NULL or a string; `format` is NULL or a format; `on_block` is NULL or may be called with `context`; `statistics` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_realtime(
    hand: wraptor_hand,
    motors: *const c_char,
    format: *const wraptor_format,
    rate: f64,
    block_limit_ms: u32,
    on_block: wraptor_on_block,
    context: *mut c_void,
    statistics: *mut wraptor_statistics,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let motors = unsafe { text("motors", motors) }?;
        let on_block = on_block.ok_or_else(|| Problem::null("on_block"))?;
        // SAFETY: the caller's promise.
        let format = unsafe { format.as_ref() }.map_or_else(Format::default, |format| format.format());
        if !RATES.contains(&rate) {
            return Err(Problem::invalid(&format!("rate: found {rate}, expected 1 to 1000 blocks/s")));
        }
        let (left, slot) = (call.left(), call.slot);
        let mut realtime = call.hand.realtime(motors, format, left)?;
        let count = realtime.axes();
        let block_limit = deadline(block_limit_ms).remaining();
        let run = realtime.run(rate, block_limit, |block, feedback| {
            let axes = axes_of(feedback, count);
            let mut controls = vec![wraptor_control::default(); count];
            let temperature = feedback.temperature.unwrap_or(0.0);
            // SAFETY: the caller's promise; both arrays have `count` elements.
            let goes_on =
                unsafe { on_block(context, block, axes.as_ptr(), count, temperature, controls.as_mut_ptr()) };
            if goes_on == 0 || slot.is_cancelled() {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(
                controls
                    .iter()
                    .map(|control| Control { velocity: control.velocity, gain: control.gain })
                    .collect(),
            )
        })?;
        realtime.end(deadline(limit_ms).remaining())?;
        let ms = |times: [Duration; 3]| times.map(|time| 1000.0 * time.as_secs_f64());
        if !statistics.is_null() {
            // SAFETY: not NULL, and by the caller's promise it may be written.
            unsafe {
                statistics.write(wraptor_statistics {
                    blocks: run.blocks,
                    missed: run.missed,
                    rate: run.rate,
                    jitter_ms: ms(run.jitter),
                    round_trip_ms: ms(run.round_trip),
                });
            }
        }
        match slot.is_cancelled() {
            false => Ok(()),
            true => Err(Problem::new(
                wraptor_error::WRAPTOR_CANCELLED,
                "RealTime: cancelled\n  next: motors stand; the next call may follow",
            )),
        }
    })
}
