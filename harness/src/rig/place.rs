//! A place in a rig file, as a command line names it, and a value for it.

use toml::{Table, Value};

use torno_text::nearest;

/// What belongs to a board itself, and not to its settings.
const OF_A_BOARD: [&str; 1] = ["clock_ppm"];

/// Puts `value` at `place` of a rig file's table: `pc.FIELD`, `GATEWAY.FIELD`, `BOARD.clock_ppm` or
/// `BOARD.TABLE.FIELD`, which is short for `board.BOARD.settings.TABLE.FIELD`.
///
/// # Errors
/// There is no such board, with the nearest that there is; or the place is none. Whether there is such a field, and
/// whether the value fits it, the rig's own check tells.
pub fn set(rig: &mut Table, place: &str, value: Value) -> Result<(), String> {
    let words: Vec<&str> = place.split('.').collect();
    let (table, words) = match &words[..] {
        [name, rest @ ..] if gateway(rig, name).is_some() => {
            (gateway(rig, name).ok_or("there is no gateway")?, rest.to_vec())
        }
        ["board", name, rest @ ..] | [name, rest @ ..] => {
            let table = board(rig, name)?;
            let own = matches!(rest, [field] if OF_A_BOARD.iter().any(|own| is_near(field, own)));
            let settings = if own || rest.is_empty() || rest[0] == "settings" { None } else { Some("settings") };
            (table, settings.into_iter().chain(rest.iter().copied()).collect())
        }
        [] => return Err("expected a place".to_owned()),
    };
    *entry(table, &words)? = value;
    Ok(())
}

/// The gateway of that name: `[pc]`, or a `[[gateway]]`.
fn gateway<'a>(rig: &'a mut Table, name: &str) -> Option<&'a mut Table> {
    if name == "pc" && rig.contains_key("pc") {
        return rig.get_mut("pc").and_then(Value::as_table_mut);
    }
    let gateways = rig.get_mut("gateway").and_then(Value::as_array_mut)?;
    let gateways = gateways.iter_mut().filter_map(Value::as_table_mut);
    gateways.into_iter().find(|gateway| gateway.get("name").and_then(Value::as_str) == Some(name))
}

/// The names of the rig's gateways.
fn gateways(rig: &Table) -> Vec<String> {
    let listed = rig.get("gateway").and_then(Value::as_array).into_iter().flatten();
    let names = listed.filter_map(|gateway| gateway.get("name").and_then(Value::as_str).map(str::to_owned));
    rig.get("pc").map(|_| "pc".to_owned()).into_iter().chain(names).collect()
}

fn is_near(field: &str, own: &str) -> bool {
    nearest(field, &[own]).contains("did you mean")
}

/// The place in `table` that the words lead to; what is not there yet comes to be.
///
/// # Errors
/// There are no words, or one leads through what is no table.
pub fn entry<'a>(table: &'a mut Table, words: &[&str]) -> Result<&'a mut Value, String> {
    let (last, tables) = words.split_last().ok_or("expected a field after it")?;
    let inner = tables.iter().try_fold(table, |table, word| {
        let entry = table.entry(*word).or_insert_with(|| Value::Table(Table::new()));
        entry.as_table_mut().ok_or_else(|| format!("'{word}' is not a table"))
    })?;
    Ok(inner.entry(*last).or_insert(Value::Integer(0)))
}

fn board<'a>(rig: &'a mut Table, name: &str) -> Result<&'a mut Table, String> {
    let gateways = gateways(rig);
    let boards = rig.get_mut("board").and_then(Value::as_array_mut).ok_or("there is no board")?;
    let label = |board: &Value| board.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
    let known: Vec<String> = boards.iter().map(label).collect();
    let Some(found) = known.iter().position(|other| other == name) else {
        let known: Vec<&str> = known.iter().chain(&gateways).map(String::as_str).chain(["board"]).collect();
        return Err(format!("there is no board '{name}'{}", nearest(name, &known)));
    };
    boards[found].as_table_mut().ok_or_else(|| "a board is no table".to_owned())
}

/// A value as a file would have it: a number, a boolean, or else text.
pub fn parsed(text: &str) -> Value {
    let integer = text.parse().map(Value::Integer).ok();
    let float = || text.parse().map(Value::Float).ok();
    let boolean = || text.parse().map(Value::Boolean).ok();
    integer.or_else(float).or_else(boolean).unwrap_or_else(|| Value::String(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gateway_is_found_by_its_name_however_the_file_writes_it() {
        let board = "[[board]]\nname = \"master\"\n";
        let gateways = "[[gateway]]\nname = \"pc\"\n[[gateway]]\nname = \"panel\"\n";
        for text in [format!("[pc]\n{board}"), format!("{gateways}{board}")] {
            let mut rig: Table = text.parse().unwrap();
            set(&mut rig, "pc.baud", Value::Integer(4_800)).unwrap();
            assert!(rig.to_string().contains("baud = 4800"), "{rig}");
            set(&mut rig, "master.plant.x", Value::Integer(1)).unwrap();
        }
        let mut rig: Table = format!("{gateways}{board}").parse().unwrap();
        set(&mut rig, "panel.baud", Value::Integer(1)).unwrap();
        assert_eq!(
            set(&mut rig, "pannel.baud", Value::Integer(1)),
            Err("there is no board 'pannel': did you mean 'panel'?".to_owned())
        );
        let mut bare: Table = board.parse().unwrap();
        assert!(set(&mut bare, "pc.baud", Value::Integer(1)).unwrap_err().starts_with("there is no board 'pc'"));
    }
}
