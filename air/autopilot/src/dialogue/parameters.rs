//! The autopilot's parameters: asked for by name, read as each firmware encodes them.

use crate::dialogue::firmware::Firmware;
use crate::messages::{MavMessage, MavParamType, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA};

/// Parameters remembered beside those that we need.
pub(crate) const KEPT: usize = 64;

/// A parameter's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameter {
    /// An integer one.
    Int(i32),
    /// A real one.
    Real(f32),
}

/// The message that asks `system`/`component` for the parameter `name` (at most 16 bytes).
#[must_use]
pub fn request(name: &str, system: u8, component: u8) -> MavMessage {
    MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
        param_index: -1, // by name
        target_system: system,
        target_component: component,
        param_id: name.into(),
    })
}

/// The message that tells a parameter: PX4 puts an integer's bytes where the float is.
#[must_use]
pub fn value(name: &str, parameter: Parameter) -> MavMessage {
    let (param_value, param_type) = match parameter {
        Parameter::Int(value) => (f32::from_bits(value.cast_unsigned()), MavParamType::MAV_PARAM_TYPE_INT32),
        Parameter::Real(value) => (value, MavParamType::MAV_PARAM_TYPE_REAL32),
    };
    let param_id = name.into();
    MavMessage::PARAM_VALUE(PARAM_VALUE_DATA { param_value, param_count: 1, param_index: 0, param_id, param_type })
}

/// Name and value that a message tells. PX4 puts an integer's bytes where the float is, ArduPilot its value. None: not
/// text, of a type that the firmware does not use, or an integer that is none.
#[must_use]
pub fn told(message: &PARAM_VALUE_DATA, firmware: Firmware) -> Option<(String, Parameter)> {
    let name = message.param_id.to_str().ok()?.trim_end_matches('\0').to_owned();
    let parameter = match (firmware, message.param_type) {
        (_, MavParamType::MAV_PARAM_TYPE_REAL32) => Parameter::Real(message.param_value),
        (Firmware::Px4, MavParamType::MAV_PARAM_TYPE_INT32) => {
            Parameter::Int(message.param_value.to_bits().cast_signed())
        }
        (
            Firmware::ArduPilot(_),
            MavParamType::MAV_PARAM_TYPE_INT8 | MavParamType::MAV_PARAM_TYPE_INT16 | MavParamType::MAV_PARAM_TYPE_INT32,
        ) => {
            let value = f64::from(message.param_value);
            let whole = value.fract() == 0.0 && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&value);
            Parameter::Int(whole.then_some(value as i32)?)
        }
        _ => return None,
    };
    Some((name, parameter))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialogue::firmware::Guided;

    const ARDUPILOT: Firmware = Firmware::ArduPilot(Guided::Guided);

    #[test]
    fn what_px4_tells_is_read_back_integers_to_the_last_bit() {
        for parameter in [Parameter::Int(-1), Parameter::Int(4), Parameter::Int(i32::MIN), Parameter::Real(0.5)] {
            let MavMessage::PARAM_VALUE(message) = value("COM_OF_LOSS_T", parameter) else { panic!() };
            let (name, back) = told(&message, Firmware::Px4).unwrap();
            assert_eq!((name.as_str(), back), ("COM_OF_LOSS_T", parameter));
        }
    }

    #[test]
    fn ardupilots_integers_are_floats_of_the_same_value() {
        let message = |param_type, param_value| PARAM_VALUE_DATA {
            param_id: "GUID_OPTIONS".into(),
            param_type,
            param_value,
            ..PARAM_VALUE_DATA::default()
        };
        let int32 = MavParamType::MAV_PARAM_TYPE_INT32;
        let read = |message| told(&message, ARDUPILOT).map(|(_, parameter)| parameter);
        assert_eq!(read(message(int32, 8.0)), Some(Parameter::Int(8)));
        assert_eq!(read(message(MavParamType::MAV_PARAM_TYPE_INT8, -1.0)), Some(Parameter::Int(-1)));
        assert_eq!(read(message(MavParamType::MAV_PARAM_TYPE_INT16, 300.0)), Some(Parameter::Int(300)));
        assert_eq!(read(message(MavParamType::MAV_PARAM_TYPE_REAL32, 0.5)), Some(Parameter::Real(0.5)));
        for nonsense in [8.5, f32::NAN, f32::INFINITY, 1e20] {
            assert_eq!(read(message(int32, nonsense)), None, "{nonsense}");
        }
        // Read as PX4's, ArduPilot's 8 would be 1090519040: with bit 3 clear.
        let (_, wrong) = told(&message(int32, 8.0), Firmware::Px4).unwrap();
        assert_eq!(wrong, Parameter::Int(1_090_519_040));
    }
}
