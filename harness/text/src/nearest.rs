//! The known name that is nearest to one that is not known.

/// The known name that is nearest to `name`, as the end of a complaint; all of them, if none is near.
pub fn nearest(name: &str, known: &[&str]) -> String {
    // Who writes `km` means `km_rad_per_s_volt`: what only lacks its end is nearer than any misspelling.
    let begins = |other: &&&str| !name.is_empty() && other.starts_with(name);
    let distance = |other: &&&str| strsim::damerau_levenshtein(name, other);
    let near = known.iter().min_by_key(|other| (!begins(other), distance(other)));
    match near {
        Some(near) if begins(&near) || distance(&near) <= 1 + near.len() / 3 => format!(": did you mean '{near}'?"),
        Some(_) => format!(": expected one of {}", known.join(", ")),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_a_misspelt_one_or_one_that_is_cut_short() {
        let known = ["k", "km_rad_per_s_volt", "alpha"];
        let found = ["alhpa", "km", "kk", "x", "nothing_like_it"].map(|name| nearest(name, &known));
        let mean = |name: &str| format!(": did you mean '{name}'?");
        let all = ": expected one of k, km_rad_per_s_volt, alpha".to_owned();
        assert_eq!(found, [mean("alpha"), mean("km_rad_per_s_volt"), mean("k"), mean("k"), all]);
    }
}
