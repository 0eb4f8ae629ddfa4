//! Writing files whole or not at all.

use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Held while a file is being put in place, so that an interrupt can wait for it.
static WRITING: Mutex<()> = Mutex::new(());

/// Returns once no file is half way, and keeps new ones from being started: to be called just before the process ends.
pub fn wait_for_writers() {
    std::mem::forget(WRITING.lock().unwrap_or_else(PoisonError::into_inner));
}

/// Writes a file by filling a temporary neighbour and renaming it, so that readers and a Ctrl-C see the old file or the new one.
///
/// # Errors
/// When the folder cannot be written to or `fill` fails; the old file then stands untouched.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    let _writing = WRITING.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut temporary = tempfile::Builder::new().prefix(".cellmap-").tempfile_in(folder)?;
    {
        let mut buffer = BufWriter::new(temporary.as_file_mut());
        fill(&mut buffer)?;
        buffer.flush()?;
    }
    temporary.as_file().sync_all()?;
    // A temporary file is private to its owner; a result is as readable as any file the user makes.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        temporary.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    temporary.persist(path).map_err(|e| e.error)?;
    Ok(())
}
