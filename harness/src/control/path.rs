//! Where a control socket is.

use std::path::{Path, PathBuf};

/// The place of the control socket of the rig whose PC port is linked at `link`: beside it, with `-control` for `-pc`.
pub fn socket_beside(link: &Path) -> PathBuf {
    let name = link.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let rig = name.strip_suffix("-pc").unwrap_or(&name);
    link.with_file_name(format!("{rig}-control"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lies_beside_the_link() {
        assert_eq!(socket_beside(Path::new("/run/torno/lathe-pc")), Path::new("/run/torno/lathe-control"));
        assert_eq!(socket_beside(Path::new("port")), Path::new("port-control"));
    }
}
