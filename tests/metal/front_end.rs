//! The emulated board's front end against the firmware's reading of it.

use board_emu::analog::FrontEnd;
use hil_world::board::SimBoard;
use hil_world::plant::Model;
use tater_f103::scale;
use tater_wire::Node;

/// Input 5 is the supply current, 1 the voltage, 2 strain, 3 and 4 thermistors (`bsp/pins.rs`).
#[test]
fn firmware_reads_the_values_at_the_motor() {
    let node = Node::new(1).expect("a node");
    for volts in [12.0, 24.0, 36.0] {
        let mut rig = SimBoard::standard(node, Model::Averaged, 1).rig().clone();
        rig.set_bus(volts);
        let inputs = FrontEnd::new().sample(&mut rig.clone());
        let said = rig.analog();
        // Rig and front end each quantize: 1.5 codes of noise and rounding, 9 mV and 10 mA each.
        assert!(scale::bus(inputs[1]).0.abs_diff((volts * 1000.0) as u16) <= 18, "{volts} V: {}", inputs[1]);
        assert!(scale::current(inputs[5]).0.abs() <= 20, "{}", inputs[5]);
        assert_eq!(scale::strain(inputs[2]), said.strain);
        // The rig's thermistor has steps of 0.05 degrees; the firmware's table is within 0.3.
        assert!(scale::temperature(inputs[3]).0.abs_diff(said.motor_temp.0) <= 4, "{}", inputs[3]);
        assert!(scale::temperature(inputs[4]).0.abs_diff(said.board_temp.0) <= 4, "{}", inputs[4]);
    }
}
