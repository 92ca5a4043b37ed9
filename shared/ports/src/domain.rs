//! Domains keep pipelines and tests on one machine apart.

use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use crate::PortError;

/// A named space of services: its own prefix in shared memory and its own folder for sockets and registrations.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    name: String,
}

impl Domain {
    /// The domain of a pipeline that names none.
    pub const DEFAULT: &str = "evac";

    /// A domain by name: 1 to 32 ASCII letters, digits, `-` or `_`.
    ///
    /// # Errors
    /// [`PortError::BadDomain`].
    pub fn new(name: &str) -> Result<Self, PortError> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        let cause = match name.len() {
            0 => "is empty",
            33.. => "is too long",
            _ if !name.chars().all(allowed) => "has a character that is not allowed",
            _ => return Ok(Self { name: name.to_owned() }),
        };
        Err(PortError::BadDomain { name: name.to_owned(), cause: cause.to_owned() })
    }

    /// Where this domain's shadows write: nobody in the domain itself hears them.
    ///
    /// # Errors
    /// [`PortError::BadDomain`] where the name has no room for the addition.
    pub fn of_shadows(&self) -> Result<Self, PortError> {
        Self::new(&format!("{}-shadow", self.name))
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Prefix of everything the domain owns in `/dev/shm`.
    pub fn prefix(&self) -> String {
        format!("evac-{}-{}_", rustix::process::getuid().as_raw(), self.name)
    }

    /// Folder for sockets and registrations, one a user and domain.
    pub fn folder(&self) -> PathBuf {
        let uid = rustix::process::getuid().as_raw();
        PathBuf::from(format!("/tmp/evac-{uid}")).join(&self.name)
    }

    /// Creates the folder, readable by this user only.
    pub(crate) fn create_folder(&self) -> Result<(), PortError> {
        let refuse = |cause: std::io::Error| PortError::BadDomain {
            name: self.name.clone(),
            cause: format!("its folder {} cannot be used: {cause}", self.folder().display()),
        };
        DirBuilder::new().recursive(true).mode(0o700).create(self.folder()).map_err(refuse)?;
        // The folder's parent sits in a directory that everybody may write to: make sure it is ours.
        for folder in self.folder().ancestors().take(2) {
            // Of the path itself: another user's link to a folder of ours would make us remove that folder at the end.
            let found = fs::symlink_metadata(folder).map_err(refuse)?;
            let text = match found.uid() {
                owner if owner != rustix::process::getuid().as_raw() => format!("belongs to user {owner}"),
                _ if !found.is_dir() => "is no folder".to_owned(),
                _ => continue,
            };
            return Err(refuse(std::io::Error::other(format!("{} {text}", folder.display()))));
        }
        Ok(())
    }

    /// Takes the domain for a launcher; the lock is given back when it is dropped or the process dies.
    ///
    /// # Errors
    /// [`PortError::DomainInUse`] with the holder's pid, [`PortError::BadDomain`] where the folder cannot be used.
    pub fn lock(&self) -> Result<DomainLock, PortError> {
        self.create_folder()?;
        let path = self.lock_path();
        let refuse = |cause: std::io::Error| PortError::BadDomain {
            name: self.name.clone(),
            cause: format!("{} cannot be written: {cause}", path.display()),
        };
        let mut file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&path)
            .map_err(refuse)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(PortError::DomainInUse { domain: self.name.clone(), pid: read_pid(&mut file) });
            }
            Err(TryLockError::Error(cause)) => return Err(refuse(cause)),
        }
        file.set_len(0).map_err(refuse)?;
        file.write_all(std::process::id().to_string().as_bytes()).map_err(refuse)?;
        Ok(DomainLock { domain: self.clone(), _file: file })
    }

    /// Pid of the launcher that holds the domain, if one does.
    pub fn holder(&self) -> Option<u32> {
        let mut file = File::open(self.lock_path()).ok()?;
        match file.try_lock_shared() {
            Err(TryLockError::WouldBlock) => Some(read_pid(&mut file)),
            _ => None,
        }
    }

    fn lock_path(&self) -> PathBuf {
        self.folder().join("launcher.pid")
    }

    /// Removes what the domain left in shared memory (the middleware itself leaves at least one management file) and
    /// its folder. Only for the launcher, after all its processes have ended.
    fn remove_leftovers(&self) {
        let prefix = self.prefix();
        let leftovers = fs::read_dir("/dev/shm")
            .into_iter()
            .flatten()
            .flatten()
            .filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
        for entry in leftovers {
            remove(&entry.path(), |path| fs::remove_file(path));
        }
        remove(&self.folder(), |path| fs::remove_dir_all(path));
    }
}

fn remove(path: &Path, how: impl Fn(&Path) -> std::io::Result<()>) {
    if let Err(cause) = how(path) {
        tracing::warn!(path = %path.display(), %cause, "left behind");
    }
}

fn read_pid(file: &mut File) -> u32 {
    let mut text = String::new();
    match file.rewind().and_then(|()| file.read_to_string(&mut text)) {
        Ok(_) => text.trim().parse().unwrap_or(0),
        Err(_) => 0,
    }
}

/// A launcher's hold on its domain; dropping it removes everything the domain left behind.
#[derive(Debug)]
pub struct DomainLock {
    domain: Domain,
    _file: File,
}

impl Drop for DomainLock {
    fn drop(&mut self) {
        self.domain.remove_leftovers();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_could_escape_the_folder_are_refused() {
        for name in ["", "../x", "a/b", "a b", &"x".repeat(33)] {
            assert!(Domain::new(name).is_err(), "{name}");
        }
        assert!(Domain::new("robot-1_b").is_ok());
    }

    #[test]
    fn a_link_in_the_folder_s_place_is_refused() {
        let domain = Domain::new(&format!("link-{}", std::process::id())).unwrap();
        let target = tempfile::tempdir().unwrap();
        fs::create_dir_all(domain.folder().parent().unwrap()).unwrap();
        std::os::unix::fs::symlink(target.path(), domain.folder()).unwrap();
        let refusal = domain.lock().unwrap_err().to_string();
        assert!(refusal.contains("is no folder"), "{refusal}");
        fs::remove_file(domain.folder()).unwrap();
        assert!(target.path().exists());
    }

    #[test]
    fn a_second_launcher_is_told_who_holds_the_domain() {
        let domain = Domain::new(&format!("lock-{}", std::process::id())).unwrap();
        let lock = domain.lock().unwrap();
        let refusal = domain.lock().unwrap_err().to_string();
        assert!(refusal.contains(&std::process::id().to_string()), "{refusal}");
        assert_eq!(domain.holder(), Some(std::process::id()));
        drop(lock);
        assert!(!domain.folder().exists());
        assert_eq!(domain.holder(), None);
    }
}
