//! What a browser is told first: what the rig consists of, as its layout and its file have it.

use serde_json::{Value, json};
use torno_machines::kinds;
use torno_machines::workpiece::{Axis, Part, Source};
use torno_protocol::board::Motor;
use torno_protocol::lathe::Program;
use torno_protocol::layout::{BoardLayout, Layout};

use crate::fault::fault_kinds;
use crate::physical::Physical;
use crate::report::series::Places;
use crate::rig::file::RigFile;
use crate::saving::Product;
use crate::speed::AxisSpeed;
use crate::steering::Role;

/// The rig, in this role.
pub(super) fn rig(file: &RigFile, role: Role) -> Value {
    let mut layout = file.layout.clone();
    for AxisSpeed { node, signal, .. } in AxisSpeed::of(file) {
        layout.boards[node].description.signals.push(signal);
    }
    // A run, a replay and a scenario write their files at their end.
    let saves = Product::ALL.into_iter().filter(|product| role == Role::Up && product.check(file).is_ok());
    let plays = file.pc.dialect.counts_characters() || file.pc.dialect.name() == Program::DIALECT;
    json!({
        "rig": file.name,
        "torno": env!("CARGO_PKG_VERSION"),
        "boards": boards(&layout),
        "lines": lines(&layout),
        "charts": charts(file, &layout),
        "part": file.part.as_ref().map(|part| drawn_part(part, &layout)),
        "faults": fault_kinds(),
        "saves": saves.collect::<Vec<_>>(),
        "player": (role == Role::Up).then(|| file.pc.dialect.player_at_port()).flatten(),
        "role": role.name(),
        "plays": role == Role::Up && plays,
    })
}

fn boards(layout: &Layout) -> Vec<Value> {
    let board = |board: &BoardLayout| {
        let motor = |motor: &Motor| json!({ "name": motor.name, "capabilities": motor.capabilities });
        let description = &board.description;
        json!({
            "name": board.name,
            "kind": board.kind,
            "gateway": board.is_gateway(),
            "capabilities": description.capabilities,
            "motors": description.motors.iter().map(motor).collect::<Vec<_>>(),
            "signals": description.signals,
        })
    };
    layout.boards.iter().map(board).collect()
}

fn lines(layout: &Layout) -> Vec<Value> {
    let name = |end: (usize, u8)| layout.boards[end.0].name.as_str();
    let line = |line: &torno_protocol::layout::LineLayout| {
        json!({
            "name": line.name,
            "from": name(line.from),
            "to": name(line.to),
            "baud": line.baud,
            "dialect": line.dialect,
        })
    };
    layout.lines.iter().map(line).collect()
}

/// Which quantities are drawn together, as the report does.
fn charts(file: &RigFile, layout: &Layout) -> Vec<Value> {
    let charts = layout.boards.iter().enumerate().flat_map(|(node, board)| {
        let (description, known) = (&board.description, file.boards.get(node));
        let name = |place: Option<usize>| place.map(|place| description.signals[place].name.as_str());
        let chart = |places: Places| {
            let unit = |place: usize| description.signals[place].unit.as_str();
            let speed = places.speed.zip(known);
            let carriage =
                known.and_then(|board| kinds::carriage(&board.kind, &board.settings, places.motor).ok().flatten());
            json!({
                "name": places.name(&board.name, description),
                "board": board.name,
                "motor": places.motor,
                "what": places.what,
                "unit": unit(places.got),
                "physical": places.physical(known, description),
                "speed_in": speed.and_then(|(place, board)| Physical::of_speed(board, places.motor, unit(place))),
                "drive_in": known.and_then(|board| Physical::of_drive(board, places.motor)),
                "bed_mm": carriage.and_then(|carriage| carriage.bed_mm),
                "got": name(Some(places.got)),
                "asked": name(places.asked),
                "rest": name(places.rest),
                "drive": name(places.drive),
                "speed": name(places.speed),
                "offset": name(places.offset),
            })
        };
        Places::of(description).into_iter().map(chart).collect::<Vec<_>>()
    });
    charts.collect()
}

fn drawn_part(part: &Part, layout: &Layout) -> Value {
    let source = |Source { node, signals, per_count }: &Source| {
        let board = &layout.boards[*node];
        let names = signals.iter().map(|signal| board.description.signals[usize::from(*signal)].name.as_str());
        json!({ "board": board.name, "signals": names.collect::<Vec<_>>(), "per_count": per_count })
    };
    let axis = |axis: &Axis| json!({ "way": source(&axis.way), "start_mm": axis.start });
    json!({
        "diameter_mm": part.diameter,
        "length_mm": part.length,
        "out_mm": part.out,
        "bore_mm": part.bore,
        "side": part.side.name(),
        "surface_mm": part.surface(),
        "nose_mm": part.nose.radius_mm(),
        "chuck_mm": part.limits.chuck.map(|radius| 2.0 * radius),
        "z": axis(&part.z),
        "x": axis(&part.x),
        "spindle": source(&part.spindle),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn up(name: &str) -> Value {
        rig(&RigFile::load(name).unwrap(), Role::Up)
    }

    #[test]
    fn every_built_in_rig_has_what_is_drawn_of_it() {
        for (name, motors, turns) in
            [("lathe", 3, true), ("lathe-dspic", 3, true), ("servo", 1, false), ("engraver", 4, false)]
        {
            let drawn = up(name);
            let charts = drawn["charts"].as_array().unwrap();
            assert_eq!((charts.len(), drawn["part"].is_object()), (motors, turns), "{name}");
            for chart in charts {
                let board = drawn["boards"].as_array().unwrap().iter().find(|board| board["name"] == chart["board"]);
                let signals = board.unwrap()["signals"].as_array().unwrap();
                for role in ["got", "asked", "rest", "drive", "speed"] {
                    let named = signals.iter().any(|signal| signal["name"] == chart[role]);
                    assert!(named || chart[role].is_null(), "{name} {chart}");
                }
                assert!(!chart["asked"].is_null() || !chart["rest"].is_null(), "{name} {chart}");
            }
        }
        let lathe = up("lathe");
        assert_eq!(lathe["part"]["z"]["way"]["board"], "transverse");
        assert_eq!(lathe["boards"][2]["motors"][0]["capabilities"], json!(["Motor", "Axis"]));
        let feed = &lathe["charts"][1];
        assert!((feed["physical"]["worth"].as_f64().unwrap() - 1.0 / 450.0).abs() < 1e-9);
        assert_eq!((&feed["speed_in"]["unit"], &feed["drive_in"]["unit"]), (&json!("mm/s"), &json!("%")));
        let servo = up("servo");
        let drive = &servo["charts"][0]["drive_in"];
        assert_eq!((&drive["unit"], drive["worth"].as_f64().unwrap() * 127.0), (&json!("%"), 100.0));
        let engraver = up("engraver");
        let units = engraver["charts"].as_array().unwrap().iter().map(|chart| &chart["physical"]["unit"]);
        assert_eq!(units.collect::<Vec<_>>(), ["mm", "mm", "mm", "deg"]);
        assert_eq!(
            (&engraver["charts"][0]["bed_mm"], &engraver["charts"][3]["bed_mm"]),
            (&json!([-150.0, 150.0]), &Value::Null)
        );
    }
}
