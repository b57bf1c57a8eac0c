//! A rig without one of its boards: the other ends of its links are gateways, by which somebody's own program takes the
//! board's place.

use toml::{Table, Value};
use torno_text::nearest;

use super::file::RigFile;

/// A rig without a board.
#[derive(Clone, Debug)]
pub struct Opened {
    /// The rig.
    pub file: RigFile,
    /// The names of the gateways in the board's place: the board's, or `BOARD-PORT` for one with several links.
    pub gateways: Vec<String>,
    /// The rig turns a part that cannot be known without the board.
    pub lost_part: bool,
}

/// The rig of `file` without the board of this name.
///
/// # Errors
/// There is no such board, it has no link to another, the PC is at it, or the others are no rig without it.
pub fn open(file: &RigFile, board: &str) -> Result<Opened, String> {
    let layout = &file.layout;
    let Some(number) = layout.board(board).filter(|number| !layout.boards[*number].is_gateway()) else {
        let known: Vec<&str> = file.boards.iter().map(|board| board.name.as_str()).collect();
        return Err(format!("there is no board '{board}'{}", nearest(board, &known)));
    };
    let port = |(board, port): (usize, u8)| {
        let board = &layout.boards[board];
        format!("{}.{}", board.name, board.description.ports[usize::from(port)])
    };
    if let Some(gateway) = file.gateways().find(|gateway| gateway.to.0 == number) {
        let name = &gateway.name;
        return Err(format!("the gateway '{name}' is at '{board}': expected a board that only boards are linked to"));
    }
    // What the board sends, where it goes.
    let lines: Vec<_> = layout.lines.iter().filter(|line| line.from.0 == number).collect();
    if lines.is_empty() {
        return Err(format!("'{board}' has no link to another board: there is no other end to be opened"));
    }
    let mut table: Table = toml::from_str(&file.text).map_err(|error| error.message().to_owned())?;
    let named = |value: &Value| value.get("name").and_then(Value::as_str) == Some(board);
    tables(&mut table, "board").retain(|value| !named(value));
    let own = format!("{board}.");
    let is_own = |end: &Value| end.as_str().is_some_and(|end| end.starts_with(&own));
    let ends = |link: &Value| link.get("ends").and_then(Value::as_array).is_some_and(|ends| ends.iter().any(is_own));
    tables(&mut table, "link").retain(|link| !ends(link));
    let mut gateways = Vec::new();
    for line in &lines {
        let name = match lines.len() {
            1 => board.to_owned(),
            _ => port(line.from).replace('.', "-"),
        };
        let mut gateway = Table::new();
        gateway.insert("name".to_owned(), name.clone().into());
        gateway.insert("port".to_owned(), port(line.to).into());
        gateway.insert("baud".to_owned(), i64::from(line.baud).into());
        gateway.insert("dialect".to_owned(), line.dialect.clone().into());
        tables(&mut table, "gateway").push(gateway.into());
        gateways.push(name);
    }
    let parse = |table: &Table| {
        let text = toml::to_string(table).map_err(|error| error.to_string())?;
        RigFile::parse(&file.name, &text).map_err(|error| format!("without '{board}' it is no rig: {error}"))
    };
    let without = parse(&table);
    // What it says of a part may need the board.
    let (file, lost_part) = match without {
        Err(_) if table.remove("part").is_some() => (parse(&table)?, true),
        file => (file?, false),
    };
    Ok(Opened { file, gateways, lost_part })
}

/// The tables of this name.
fn tables<'a>(table: &'a mut Table, name: &str) -> &'a mut Vec<Value> {
    let value = table.entry(name).or_insert_with(|| Value::Array(Vec::new()));
    if !value.is_array() {
        *value = Value::Array(Vec::new());
    }
    let Value::Array(tables) = value else { unreachable!("it has just been made one") };
    tables
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lathe() -> RigFile {
        RigFile::load("lathe").unwrap()
    }

    #[test]
    fn the_other_end_of_the_link_is_a_gateway_and_the_lines_keep_their_names() {
        let lathe = lathe();
        let Opened { file, gateways, lost_part } = open(&lathe, "depth").unwrap();
        assert!(lost_part && file.part.is_none());
        assert_eq!(gateways, ["depth"]);
        assert_eq!(file.boards.len(), 3);
        let [pc, depth] = [0, 1].map(|n| file.gateways().nth(n).unwrap().clone());
        assert_eq!(
            (pc.name.as_str(), depth.name.as_str(), depth.baud, depth.dialect.name()),
            ("pc", "depth", 9600, "lathe")
        );
        let names = |file: &RigFile| {
            let mut names: Vec<String> = file.layout.lines.iter().map(|line| line.name.clone()).collect();
            names.sort();
            names
        };
        assert_eq!(names(&file), names(&lathe));
        // Its text is a rig file like any other.
        assert_eq!(RigFile::parse("lathe", &file.text).unwrap().layout, file.layout);
    }

    #[test]
    fn several_boards_can_be_left_out_and_those_with_several_links_have_several_gateways() {
        let one = open(&lathe(), "depth").unwrap().file;
        let two = open(&one, "spindle").unwrap();
        assert_eq!(
            (two.file.boards.len(), two.file.more.len(), two.gateways.as_slice()),
            (2, 2, &["spindle".to_owned()][..])
        );
        let text = "name = \"chain\"\ndialect = \"lathe\"\n[pc]\nport = \"a.pc\"\n\
                    [[board]]\nname = \"a\"\nkind = \"master\"\n[[board]]\nname = \"b\"\nkind = \"master\"\n\
                    [[board]]\nname = \"c\"\nkind = \"depth\"\n\
                    [[link]]\nends = [\"a.depth\", \"b.pc\"]\n[[link]]\nends = [\"c.master\", \"b.depth\"]\n";
        let chain = RigFile::parse("chain", text).unwrap();
        let opened = open(&chain, "b").unwrap();
        assert_eq!(opened.gateways, ["b-pc", "b-depth"]);
        assert!(!opened.lost_part);
    }

    #[test]
    fn what_cannot_be_opened_is_said_with_why() {
        for (board, expected) in [
            ("dept", "there is no board 'dept': did you mean 'depth'?"),
            ("pc", "there is no board 'pc'"),
            ("master", "the gateway 'pc' is at 'master': expected a board that only boards are linked to"),
        ] {
            let found = open(&lathe(), board).unwrap_err();
            assert!(found.starts_with(expected), "{found}");
        }
        let alone = format!("{}\n[[board]]\nname = \"spare\"\nkind = \"depth\"\n", lathe().text);
        let alone = RigFile::parse("my.toml", &alone).unwrap();
        assert!(open(&alone, "spare").unwrap_err().contains("has no link to another board"));
    }
}
