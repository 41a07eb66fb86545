//! The plant as a motor board sees it: hall lines, analog readings and a brake.

pub mod flash;
pub mod halls;
pub mod params;

pub use params::{HallGlitch, RigParams, StuckLine};

use crate::plant::supply::Feed;
use crate::plant::{Contact, Ledger, Model, ParamError, Plant, PlantParams, SharedSupply, Start, Supply};
use halls::Halls;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
pub use servo_core::sense::commutation::{Bridge, Leg};
use servo_core::units::{DeciCelsius, Duty, MilliAmps, MilliVolts};
pub use tater_fw::Analog;

/// Which way an object resists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// It resists closing.
    Closing,
    /// It resists opening.
    Opening,
}

/// The duty of a timer's compare value; `full` is 100 %.
#[must_use]
pub fn duty(compare: u32, full: u32) -> Duty {
    // 1 is not representable; the plant rounds full duty up again.
    let bits = (f64::from(compare) / f64::from(full.max(1)) * 32768.0).round().clamp(0.0, 32767.0);
    Duty::from_bits(bits as i16)
}

/// An object in the joint's way: a spring and a damper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Object {
    /// Where the joint meets it, counts.
    pub from_count: f64,
    /// Stiffness at the motor; 0.01 is soft, 20 as hard as a stop.
    pub stiffness_n_m_rad: f64,
    /// Damping at the motor while being pressed.
    pub damping_n_m_s: f64,
    /// The motion it resists.
    pub side: Side,
}

/// A hall edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HallChange {
    /// The new code.
    pub code: u8,
    /// When, µs since the start.
    pub at_us: u64,
}

/// The true state of the plant; for traces and checks, never for the servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Time since the start, µs.
    pub t_us: u64,
    /// Rotor position, counts.
    pub counts: f64,
    /// Rotor velocity, counts/s.
    pub counts_per_s: f64,
    /// Torque of the motor, N·m, mean over the last step.
    pub torque_n_m: f64,
    /// Phase currents into the winding, A.
    pub phase_a: [f64; 3],
    /// Largest phase current between the last two ADC readings (one tick), A.
    pub peak_phase_a: f64,
    /// Charge drawn from the bus since the start, C.
    pub bus_charge_c: f64,
    /// Torque of contacts and disturbance, referred to the motor through a lossless gear, N·m; positive closes.
    pub load_n_m: f64,
    /// What a person's finger in the joint's way feels, N·m at the motor.
    pub finger_n_m: f64,
    /// Energy that it stores, J.
    pub finger_j: f64,
    /// Winding temperature, °C.
    pub winding_c: f64,
    /// Housing temperature, °C.
    pub housing_c: f64,
    /// Whether the brake is engaged.
    pub brake_engaged: bool,
    /// Energy balance since the start.
    pub ledger: Ledger,
}

/// An input of the ADC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Bus voltage.
    Bus,
    /// Bus current.
    Current,
    /// The motor's thermistor.
    Thermistor,
    /// The strain gauge.
    Strain,
}

impl Input {
    /// All inputs.
    pub const ALL: [Self; 4] = [Self::Bus, Self::Current, Self::Thermistor, Self::Strain];
}

/// A fault of an input; the default is none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InputFault {
    /// Share of the range at which it is stuck: 0 and 1 are the rails.
    pub stuck_at: Option<f64>,
    /// Offset, as a share of the range: drift.
    pub offset: f64,
    /// Noise beyond the rig's own, uniform ± this many codes.
    pub noise_lsb: f64,
}

/// Rise of the board above ambient by its own losses, °C; chosen: 1 W into 10 K/W.
const BOARD_RISE_C: f64 = 10.0;

/// Fraction of the motor housing's rise that reaches the board through the palm; chosen.
const BOARD_SHARE: f64 = 0.25;

/// One motor with its sensors.
#[derive(Clone, Debug)]
pub struct Rig {
    plant: Plant,
    feed: Feed,
    /// Bus charge up to which the supply has been told, C.
    fed_c: f64,
    params: RigParams,
    halls: Halls,
    rng: Pcg64Mcg,
    brake_engaged: bool,
    brake_moves_at: Option<u64>,
    tripped: bool,
    guarded_outside: bool,
    thermistor_c: f64,
    thermistor_fault_c: Option<f64>,
    /// Faults of the ADC's inputs, in the order of [`Input`].
    inputs: [InputFault; 4],
    brake_stuck: Option<bool>,
    /// Friction that holds the joint, N·m at the motor.
    jam_n_m: f64,
    /// Time and bus charge at the last reading.
    last_read: (u64, f64),
    peak_phase_a: f64,
    last_edge_us: u64,
}

impl Rig {
    /// A rig at its start, brake engaged; `seed` is that of the ADC's noise and of the hall edges' jitter.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn new(
        plant: PlantParams,
        rig: RigParams,
        objects: &[Object],
        model: Model,
        start: Start,
        seed: u64,
    ) -> Result<Self, ParamError> {
        rig.validate()?;
        let mut contacts = Vec::new();
        for o in objects {
            crate::plant::params::check(&[
                ("from_count", o.from_count, -1e6, 1e6),
                ("stiffness_n_m_rad", o.stiffness_n_m_rad, 0.0, 1000.0),
                ("damping_n_m_s", o.damping_n_m_s, 0.0, 10.0),
            ])?;
            let side = if o.side == Side::Closing { 1.0 } else { -1.0 };
            if side * (start.count - o.from_count) > 0.0 {
                let which = if side > 0.0 { "at or above" } else { "at or below" };
                let expected = format!("{which} the rotor's start at {}, which is inside it", start.count);
                return Err(ParamError { field: "from_count", found: o.from_count, expected });
            }
            contacts.push(Contact {
                from: o.from_count * plant.rad_per_count(),
                side,
                stiffness: o.stiffness_n_m_rad,
                damping: o.damping_n_m_s,
            });
        }
        let plant = Plant::new(plant, &contacts, model, start)?;
        Ok(Self {
            // The plant's own value, rounded by its radians, so that the first step starts within the bounds.
            halls: Halls::new(rig.clone(), plant.params().zero_sector, plant.counts(), seed),
            params: rig,
            feed: Feed::Own(Supply::new(plant.params().bus_v, 1)),
            fed_c: 0.0,
            plant,
            rng: Pcg64Mcg::new(u128::from(seed) << 64 | 0xadc),
            brake_engaged: true,
            brake_moves_at: None,
            tripped: false,
            guarded_outside: false,
            thermistor_c: start.heat.housing_c,
            thermistor_fault_c: None,
            inputs: [InputFault::default(); 4],
            brake_stuck: None,
            jam_n_m: 0.0,
            last_read: (0, 0.0),
            peak_phase_a: 0.0,
            last_edge_us: 0,
        })
    }

    /// The same rig starting at `us` instead of 0, for a board that has been running.
    #[must_use]
    pub fn starting_at(mut self, us: u64) -> Self {
        self.plant.start_at(us);
        if let Feed::Own(supply) = &mut self.feed {
            supply.start_at(us);
        }
        for glitch in &mut self.params.glitches {
            glitch.at_us += us;
        }
        if let Some(stuck) = &mut self.params.stuck {
            stuck.from_us += us;
        }
        self.halls = self.halls.anew(self.params.clone(), self.plant.counts());
        self.last_read.0 = us;
        self.last_edge_us = us;
        self
    }

    /// Time of the last hall edge, µs; the start if there was none.
    #[must_use]
    pub const fn last_edge_us(&self) -> u64 {
        self.last_edge_us
    }

    /// Time since the start, µs.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.plant.state().t_us
    }

    /// The hall code now.
    #[must_use]
    pub fn halls(&self) -> u8 {
        self.halls.lines()
    }

    /// The true count of the sensors, whatever their lines show.
    #[must_use]
    pub const fn hall_cell(&self) -> i64 {
        self.halls.cell()
    }

    /// See [`Halls::settled`].
    #[must_use]
    pub fn settled_counts(&self) -> f64 {
        self.halls.settled(self.plant.counts())
    }

    /// See [`Plant::set_max_step_us`].
    pub fn set_max_step_us(&mut self, us: u64) {
        self.plant.set_max_step_us(us);
    }

    /// See [`Plant::set_disturbance`].
    pub fn set_disturbance(&mut self, n_m: f64) {
        self.plant.set_disturbance(n_m);
    }

    /// See [`Plant::set_shaft_torque`].
    pub fn set_shaft_torque(&mut self, n_m: f64) {
        self.plant.set_shaft_torque(n_m);
    }

    /// See [`Plant::set_objects`].
    pub fn set_objects(&mut self, objects: &[Contact]) {
        self.plant.set_objects(objects);
    }

    /// See [`Plant::set_finger`].
    pub fn set_finger(&mut self, finger: Option<Contact>) {
        self.plant.set_finger(finger);
    }

    /// Position of the joint behind the gear's play and twist, counts of the motor.
    #[must_use]
    pub fn joint_counts(&self) -> f64 {
        self.plant.joint_counts()
    }

    /// Energy stored in the objects in the joint's way, J.
    #[must_use]
    pub fn objects_j(&self) -> f64 {
        self.plant.objects_j()
    }

    /// Feeds this board alone from another supply at `v`; its capacitor takes the voltage at once.
    pub fn set_bus(&mut self, v: f64) {
        let mut supply = Supply::new(v.max(0.0), 1);
        supply.start_at(self.now_us());
        self.feed = Feed::Own(supply);
        self.plant.set_bus(v);
    }

    /// Feeds the board from a supply that others share. From then on the caller advances all of them to the same times, none
    /// beyond [`Self::next_exchange_us`].
    pub fn share(&mut self, supply: &SharedSupply) {
        self.feed = Feed::Shared(supply.clone());
    }

    /// The supply that feeds the board.
    #[must_use]
    pub fn supply(&self) -> Supply {
        match &self.feed {
            Feed::Own(supply) => supply.clone(),
            Feed::Shared(supply) => supply.read(),
        }
    }

    /// The end of the interval in which a shared supply's voltage holds, µs; `u64::MAX` for a supply of its own.
    #[must_use]
    pub fn next_exchange_us(&self) -> u64 {
        match &self.feed {
            Feed::Own(_) => u64::MAX,
            Feed::Shared(supply) => supply.interval(self.now_us()).1,
        }
    }

    /// Tells the supply what the last step drew.
    fn draw(&mut self) {
        let drawn = self.plant.state().bus_charge - self.fed_c;
        self.fed_c = self.plant.state().bus_charge;
        let volts = match &mut self.feed {
            Feed::Own(supply) => {
                supply.draw(drawn);
                supply.advance(self.plant.state().t_us);
                supply.volts()
            }
            Feed::Shared(supply) => return supply.draw(drawn),
        };
        self.follow_bus(volts);
    }

    fn follow_bus(&mut self, volts: f64) {
        if volts != self.plant.params().bus_v {
            self.plant.set_bus(volts);
        }
    }

    /// Breaks hall lines 0 to 2, each at a level: an open cable reads high through its pull-up. `None`: the line follows its sensor.
    pub fn break_hall_lines(&mut self, levels: [Option<bool>; 3]) {
        self.halls.break_lines(levels);
    }

    /// Forces the thermistor reading, °C: an open wire reads -50, a short 155. `None`: it follows the motor's housing.
    pub const fn override_thermistor(&mut self, celsius: Option<f64>) {
        self.thermistor_fault_c = celsius;
    }

    /// Rewires the motor: the phase on each leg, the sensor on each hall line, and which lines are inverted. It must stand, and the
    /// board must start afterwards.
    ///
    /// # Errors
    /// An order that is none.
    pub fn rewire(&mut self, phases: [u8; 3], halls: [u8; 3], inverted: [bool; 3]) -> Result<(), ParamError> {
        let params = RigParams { phases, halls, inverted, ..self.params.clone() };
        params.validate()?;
        self.halls = self.halls.anew(params.clone(), self.plant.counts());
        self.params = params;
        Ok(())
    }

    /// Makes the brake stick, engaged (`Some(true)`) or released, whatever the board orders; `None`: it obeys.
    pub const fn stick_brake(&mut self, engaged: Option<bool>) {
        self.brake_stuck = engaged;
    }

    /// Jams the joint with a friction in N·m at the motor; 0 frees it.
    pub const fn jam(&mut self, n_m: f64) {
        self.jam_n_m = n_m;
    }

    /// Disturbs an input of the ADC, until it gets the default.
    pub const fn disturb_input(&mut self, input: Input, fault: InputFault) {
        self.inputs[input as usize] = fault;
    }

    /// Puts a wrong code on the hall lines for a time; ignored while another one is to come.
    pub fn add_glitch(&mut self, glitch: HallGlitch) {
        self.halls.add_glitch(glitch);
    }

    /// Trips the over-current comparator, as a short of the phase cable does; the bridge is off until the board has switched it off.
    pub const fn trip(&mut self) {
        self.tripped = true;
    }

    /// How the motor is connected, and its sensors.
    #[must_use]
    pub const fn params(&self) -> &RigParams {
        &self.params
    }

    /// The plant's parameters, with the present supply voltage.
    #[must_use]
    pub fn plant(&self) -> &PlantParams {
        self.plant.params()
    }

    /// Makes the board handle over-current: [`Self::advance`] returns on a trip instead of switching the bridge off.
    pub const fn guard_outside(&mut self) {
        self.guarded_outside = true;
    }

    /// Whether over-current has tripped since the bridge was last off.
    #[must_use]
    pub const fn tripped(&self) -> bool {
        self.tripped
    }

    /// The plant's dead time, ns.
    #[must_use]
    pub fn dead_time_ns(&self) -> f64 {
        self.plant.params().dead_time_us * 1000.0
    }

    /// Advances with bridge and brake held to `until_us` or to the next hall edge (within 1 µs), and returns the edge.
    pub fn advance(&mut self, bridge: Bridge, brake_released: bool, until_us: u64) -> Option<HallChange> {
        if bridge == Bridge::Off {
            self.tripped = false;
        }
        self.command_brake(self.brake_stuck.map_or(brake_released, |engaged| !engaged));
        let bridge = self.at_motor(bridge);
        while self.now_us() < until_us {
            let mut tripped_now = false;
            let now = self.now_us();
            if self.brake_moves_at.is_some_and(|at| at <= now) {
                self.brake_engaged = !self.brake_engaged;
                self.brake_moves_at = None;
            }
            let mut event = self.halls.next_event(now).min(self.brake_moves_at.unwrap_or(u64::MAX));
            if let Feed::Shared(supply) = &self.feed {
                let (volts, until_us) = supply.interval(now);
                event = event.min(until_us);
                self.follow_bus(volts);
            }
            let bridge = if self.tripped && !self.guarded_outside { Bridge::Off } else { bridge };
            self.step(bridge, self.plant.step_to(until_us.min(event)));
            self.draw();
            let trip = self.plant.params().trip_a;
            if self.plant.state().current.iter().any(|i| i.abs() > trip) {
                tripped_now = !self.tripped;
                self.tripped = true;
            }
            if self.halls.update(self.plant.counts(), self.now_us()) {
                self.last_edge_us = self.now_us();
                return Some(HallChange { code: self.halls.lines(), at_us: self.now_us() });
            }
            if tripped_now && self.guarded_outside {
                return None;
            }
        }
        None
    }

    fn command_brake(&mut self, released: bool) {
        if released != self.brake_engaged {
            self.brake_moves_at = None;
        } else if self.brake_moves_at.is_none() {
            let delay_us = self.plant.params().brake_delay_ms * 1000.0;
            self.brake_moves_at = Some(self.now_us() + delay_us as u64);
        }
    }

    /// The bridge as the motor's phases see it.
    fn at_motor(&self, bridge: Bridge) -> Bridge {
        let Bridge::On { legs, duty } = bridge else { return Bridge::Off };
        let mut phases = [Leg::Float; 3];
        for ((&phase, leg), open) in self.params.phases.iter().zip(legs).zip(self.params.open) {
            if !open {
                phases[usize::from(phase)] = leg;
            }
        }
        Bridge::On { legs: phases, duty }
    }

    /// Steps to `to_us`, or to the first whole microsecond beyond a hall boundary.
    fn step(&mut self, bridge: Bridge, to_us: u64) {
        let brake = self.jam_n_m + if self.brake_engaged { self.plant.params().brake_n_m } else { 0.0 };
        let (low, high) = self.halls.bounds();
        let from = *self.plant.state();
        self.plant.step(bridge, brake, to_us);
        let end = self.plant.counts();
        if end >= low && end < high {
            return;
        }
        let (dir, boundary) = if end < low { (-1.0, low) } else { (1.0, high) };
        let steps = (to_us - from.t_us) as f64;
        let start = from.shaft.theta / self.plant.rad_per_count();
        // Under constant acceleration the fraction of the step until the boundary solves a quadratic; with velocity and distance
        // positive towards the boundary, this form is stable as the acceleration goes to zero.
        let v0 = dir * from.shaft.omega / self.plant.rad_per_count() * steps * 1e-6;
        let curve = dir * (end - start) - v0;
        let to_go = dir * (boundary - start);
        let share = 2.0 * to_go / (v0 + (v0 * v0 + 4.0 * curve * to_go).max(0.0).sqrt());
        // A start at rest on the boundary gives 0/0; `max` turns that into the shortest step, so time always advances.
        let us = (share * steps).ceil().max(1.0).min(steps) as u64;
        if from.t_us + us < to_us {
            self.plant.restore(from);
            self.plant.step(bridge, brake, from.t_us + us);
        }
    }

    /// Reads the ADC, 12 bits each: bus voltage over 36.3 V, bus current over ±20 A as the mean since the last reading, the housing's
    /// thermistor over −50..155 °C, the board's temperature, the strain gauge.
    pub fn analog(&mut self) -> Analog {
        let s = *self.plant.state();
        let dt = (s.t_us - self.last_read.0) as f64 * 1e-6;
        let current = if dt > 0.0 { (s.bus_charge - self.last_read.1) / dt } else { 0.0 };
        self.last_read = (s.t_us, s.bus_charge);
        self.peak_phase_a = self.plant.take_peak();
        let lag = self.params.thermistor_lag_s;
        self.thermistor_c += (self.plant.heat().housing_c - self.thermistor_c) * (1.0 - libm::exp(-dt / lag));
        let joint = -s.shaft.load * self.plant.params().gear_ratio;
        let strain = self.params.strain_zero + joint * self.params.strain_per_n_m;
        let bus_v = self.plant.params().bus_v;
        let ambient_c = self.plant.params().ambient_c;
        let board_c = ambient_c + BOARD_RISE_C + BOARD_SHARE * (self.plant.heat().housing_c - ambient_c);
        let bus = self.adc(Input::Bus, bus_v, 0.0, 36.3);
        let current = self.adc(Input::Current, current, -20.0, 20.0);
        let thermistor =
            self.adc(Input::Thermistor, self.thermistor_fault_c.unwrap_or(self.thermistor_c), -50.0, 155.0);
        let strain = self.adc(Input::Strain, strain, 0.0, 255.0).round();
        Analog {
            bus: MilliVolts((1000.0 * bus).round() as u16),
            current: MilliAmps((1000.0 * current).round() as i16),
            motor_temp: DeciCelsius((10.0 * thermistor).round() as i16),
            // A digital sensor: no noise.
            board_temp: DeciCelsius((10.0 * board_c).round() as i16),
            strain: strain as u8,
            raw: [(strain * 16.0) as u16, ((thermistor + 50.0) / 205.0 * 4095.0).round() as u16],
            bridge_fault: self.tripped,
        }
    }

    fn adc(&mut self, input: Input, value: f64, min: f64, max: f64) -> f64 {
        let InputFault { stuck_at, offset, noise_lsb } = self.inputs[input as usize];
        // The strain gauge has eight bits.
        let codes = if matches!(input, Input::Strain) { 255.0 } else { 4095.0 };
        let step = (max - min) / codes;
        let noise = (self.params.adc_noise_lsb + noise_lsb) * self.rng.random_range(-1.0..=1.0);
        let true_code = (value - min) / step + offset * codes;
        let code = (stuck_at.map_or(true_code, |share| share * codes) + noise).round().clamp(0.0, codes);
        min + code * step
    }

    /// The true state.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let s = self.plant.state();
        let heat = self.plant.heat();
        let (finger_n_m, finger_j) = self.plant.on_finger();
        Truth {
            t_us: s.t_us,
            counts: self.plant.counts(),
            counts_per_s: s.shaft.omega / self.plant.rad_per_count(),
            torque_n_m: s.torque,
            phase_a: s.current,
            peak_phase_a: self.peak_phase_a,
            bus_charge_c: s.bus_charge,
            load_n_m: s.shaft.load,
            finger_n_m,
            finger_j,
            winding_c: heat.winding_c,
            housing_c: heat.housing_c,
            brake_engaged: self.brake_engaged,
            ledger: self.plant.ledger(),
        }
    }
}
