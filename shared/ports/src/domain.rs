//! Domains keep pipelines and tests on one machine apart.

use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt as _, PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use crate::PortError;

/// Folders of the middleware's registrations in a domain's folder.
const REGISTERED: [&str; 2] = ["nodes", "services"];

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

    /// Where the middleware keeps who is in the domain and which services there are. It syncs each of some fifty files that a stage
    /// writes there as it starts; on a disk that others write to this takes up to a second, in memory none.
    fn registry(&self) -> PathBuf {
        PathBuf::from("/dev/shm").join(format!("{}registry", self.prefix()))
    }

    /// Creates the folder, readable by this user only, with the registry that it leads to.
    pub(crate) fn create_folder(&self) -> Result<(), PortError> {
        let refuse = |cause: std::io::Error| PortError::BadDomain {
            name: self.name.clone(),
            cause: format!("its folder {} cannot be used: {cause}", self.folder().display()),
        };
        let create = |folder: &Path| DirBuilder::new().recursive(true).mode(0o700).create(folder);
        create(&self.folder()).and_then(|()| create(&self.registry())).map_err(refuse)?;
        // Both sit in directories that everybody may write to: make sure that they are ours.
        for folder in self.folder().ancestors().take(2).chain([self.registry().as_path()]) {
            // Of the path itself: another user's link to a folder of ours would make us remove that folder at the end.
            let found = fs::symlink_metadata(folder).map_err(refuse)?;
            let text = match found.uid() {
                owner if owner != rustix::process::getuid().as_raw() => format!("belongs to user {owner}"),
                _ if !found.is_dir() => "is no folder".to_owned(),
                _ => continue,
            };
            return Err(refuse(std::io::Error::other(format!("{} {text}", folder.display()))));
        }
        for part in REGISTERED {
            let place = self.registry().join(part);
            create(&place).map_err(refuse)?;
            match symlink(&place, self.folder().join(part)) {
                Err(cause) if cause.kind() != ErrorKind::AlreadyExists => return Err(refuse(cause)),
                _ => {}
            }
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
            .mode(0o600)
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

    /// Pid of a launcher that has held the domain and did not leave it in order.
    pub fn left_by(&self) -> Option<u32> {
        let mut file = File::open(self.lock_path()).ok()?;
        file.try_lock_shared().ok()?;
        Some(read_pid(&mut file)).filter(|pid| *pid > 0)
    }

    /// Takes from other users what the middleware lets them write to: a file without content that it manages nodes by.
    pub(crate) fn close_to_others(&self) {
        for (path, metadata) in self.in_memory() {
            let mode = metadata.permissions().mode();
            if mode & 0o077 != 0 && metadata.uid() == rustix::process::getuid().as_raw() {
                // It may be gone by now.
                let _ = fs::set_permissions(path, fs::Permissions::from_mode(mode & 0o700));
            }
        }
    }

    /// What the domain has in shared memory.
    fn in_memory(&self) -> impl Iterator<Item = (PathBuf, fs::Metadata)> {
        let prefix = self.prefix();
        let files = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        files
            .filter(move |entry| entry.file_name().to_string_lossy().starts_with(&prefix))
            .filter_map(|entry| Some((entry.path(), entry.metadata().ok()?)))
    }

    /// How much the domain takes of shared memory: files, and bytes of pages that were touched.
    pub fn shared_memory(&self) -> (usize, u64) {
        self.in_memory().fold((0, 0), |(files, bytes), (_, file)| (files + 1, bytes + file.blocks() * 512))
    }

    fn lock_path(&self) -> PathBuf {
        self.folder().join("launcher.pid")
    }

    /// Removes what the domain left in shared memory (the middleware itself leaves at least one management file) and
    /// its folder. Only for the launcher, after all its processes have ended.
    fn remove_leftovers(&self) {
        for (path, found) in self.in_memory() {
            remove(
                &path,
                |path| if found.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) },
            );
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
    fn what_the_middleware_registers_is_in_memory_and_goes_with_the_domain() {
        let domain = Domain::new(&format!("registry-{}", std::process::id())).unwrap();
        let lock = domain.lock().unwrap();
        let bus = crate::Bus::join(&domain, "test").unwrap();
        let nodes = fs::canonicalize(domain.folder().join("nodes")).unwrap();
        assert!(nodes.starts_with("/dev/shm") && fs::read_dir(&nodes).unwrap().count() > 0, "{nodes:?}");
        drop(bus);
        drop(lock);
        assert!(!domain.registry().exists());
    }

    #[test]
    fn a_link_in_the_registry_s_place_is_refused() {
        let domain = Domain::new(&format!("elsewhere-{}", std::process::id())).unwrap();
        let target = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink(target.path(), domain.registry()).unwrap();
        let refusal = domain.lock().unwrap_err().to_string();
        assert!(refusal.contains("registry is no folder"), "{refusal}");
        assert_eq!(fs::read_dir(target.path()).unwrap().count(), 0);
        domain.remove_leftovers();
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
