//! What the text of a rig file meant when the first recordings that are still read were made.

use toml::{Table, Value};

/// The law of the feed axis and its rules then; what a text says itself still holds.
const FEED: &str = r#"
k2 = 0.5
k2_standing = 0.5
breakaway = 0.0
dead_band_counts = 0
wait_counts = 0
judged_by = "time"
"#;

/// The text with all that has another default today.
pub(super) fn spelled_out(text: &str) -> Option<String> {
    let mut rig: Table = toml::from_str(text).ok()?;
    let feed: Table = toml::from_str(FEED).ok()?;
    for board in rig.get_mut("board")?.as_array_mut()? {
        let board = board.as_table_mut()?;
        let axis: &[&str] = match board.get("kind").and_then(Value::as_str) {
            Some("transverse") => &["settings", "controller"],
            Some("dspic") => &["settings", "transverse", "controller"],
            _ => continue,
        };
        let controller = axis.iter().try_fold(board, |table, name| table_in(table, name))?;
        for (setting, value) in &feed {
            controller.entry(setting).or_insert_with(|| value.clone());
        }
    }
    toml::to_string(&rig).ok()
}

fn table_in<'a>(table: &'a mut Table, name: &str) -> Option<&'a mut Table> {
    table.entry(name).or_insert_with(|| Value::Table(Table::new())).as_table_mut()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_text_says_itself_holds() {
        let text = "[[board]]\nkind = 'transverse'\n[board.settings.controller]\nk2 = 2\n[[board]]\nkind = 'dspic'\n";
        let rig: Table = toml::from_str(&spelled_out(text).unwrap()).unwrap();
        let boards = rig["board"].as_array().unwrap();
        assert_eq!(boards[0]["settings"]["controller"]["k2"].as_integer(), Some(2));
        assert_eq!(boards[0]["settings"]["controller"]["judged_by"].as_str(), Some("time"));
        assert_eq!(boards[1]["settings"]["transverse"]["controller"]["k2"].as_float(), Some(0.5));
        assert_eq!(spelled_out("no rig"), None);
    }
}
