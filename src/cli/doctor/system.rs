//! How the doctor sees the system: files below a root, who uses the cameras, and room on file systems. Tests give it a root of their own.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Name of the service's user and of the group of its clients.
pub const SERVICE: &str = "pelical";

/// Links in a row, as the kernel has it.
const MAX_LINKS: usize = 40;

/// Bytes of a file system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Free for users.
    pub free: u64,
    /// In all.
    pub total: u64,
}

/// What of a system can be looked at.
#[derive(Debug, Clone)]
pub struct System {
    /// Where its files are.
    pub root: PathBuf,
    /// User id of who asks.
    pub uid: u32,
    /// Group ids of who asks, in this session.
    pub gids: Vec<u32>,
    /// Whether it is the system that runs, so that processes can be asked too.
    pub is_running: bool,
    /// Room on the file system of a path.
    pub space: fn(&Path) -> Option<Space>,
}

/// A user of the system, and the groups it is in by the system's files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct User {
    /// Name.
    pub name: String,
    /// User id.
    pub uid: u32,
    /// Group ids.
    pub gids: Vec<u32>,
}

/// Who may read and write a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rights {
    /// Owner.
    pub uid: u32,
    /// Group.
    pub gid: u32,
    /// Permission bits.
    pub mode: u32,
}

impl System {
    /// The system below `root`; that which runs where it is `None`.
    pub fn new(root: Option<&Path>) -> Self {
        let mut gids = vec![rustix::process::getegid().as_raw()];
        gids.extend(rustix::process::getgroups().unwrap_or_default().iter().map(|gid| gid.as_raw()));
        Self {
            root: root.unwrap_or(Path::new("/")).to_owned(),
            uid: rustix::process::geteuid().as_raw(),
            gids,
            is_running: root.is_none(),
            space,
        }
    }

    /// Where a file of the system is.
    pub fn path(&self, absolute: impl AsRef<Path>) -> PathBuf {
        let absolute = absolute.as_ref();
        // A path of the config may be relative to where one stands.
        if self.is_running {
            return absolute.to_owned();
        }
        self.root.join(absolute.strip_prefix("/").unwrap_or(absolute))
    }

    /// A file without the white space around it; `None` where it cannot be read.
    pub fn read(&self, absolute: impl AsRef<Path>) -> Option<String> {
        fs::read_to_string(self.path(absolute)).ok().map(|text| text.trim().to_owned())
    }

    /// Names in a folder, sorted; none where it cannot be read.
    pub fn names(&self, absolute: impl AsRef<Path>) -> Vec<String> {
        let entries = fs::read_dir(self.path(absolute)).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort();
        names
    }

    /// Whether there is a file or folder of this name; a link counts where it leads somewhere in the running system.
    pub fn exists(&self, absolute: impl AsRef<Path>) -> bool {
        fs::symlink_metadata(self.path(absolute)).is_ok()
    }

    /// The file of the system that a path leads to, links followed below the root; `None` where it leads nowhere.
    pub fn follow(&self, absolute: impl AsRef<Path>) -> Option<PathBuf> {
        let mut file = absolute.as_ref().to_owned();
        for _ in 0..MAX_LINKS {
            let Ok(target) = fs::read_link(self.path(&file)) else {
                return self.exists(&file).then_some(file);
            };
            // An absolute target replaces what it is joined to.
            file = file.parent().unwrap_or(Path::new("/")).join(target);
        }
        None
    }

    /// Who may use a file; `None` where it is not there.
    pub fn rights(&self, absolute: impl AsRef<Path>) -> Option<Rights> {
        let found = fs::metadata(self.path(absolute)).ok()?;
        Some(Rights { uid: found.uid(), gid: found.gid(), mode: found.mode() & 0o777 })
    }

    /// Whether a user may read and write a file; `None` where it is not there.
    pub fn may_use(&self, user: &User, absolute: impl AsRef<Path>) -> Option<bool> {
        let file = absolute.as_ref();
        let rights = self.rights(file)?;
        if self.is_running && user.uid == self.uid {
            // The kernel knows access control lists too.
            let wanted = rustix::fs::Access::READ_OK | rustix::fs::Access::WRITE_OK;
            return Some(rustix::fs::access(file, wanted).is_ok());
        }
        Some(user.may_use(rights))
    }

    /// The id and the members of a group; `None` where there is none of that name.
    pub fn group(&self, name: &str) -> Option<(u32, Vec<String>)> {
        let text = self.read("/etc/group")?;
        let fields = text.lines().map(|line| line.split(':').collect::<Vec<_>>());
        let found = fields.into_iter().find(|fields| fields.first() == Some(&name))?;
        let members = found.get(3).map_or("", |members| members).split(',').filter(|name| !name.is_empty());
        Some((found.get(2)?.parse().ok()?, members.map(str::to_owned).collect()))
    }

    /// The user of this name.
    pub fn user(&self, name: &str) -> Option<User> {
        self.find_user(|fields| fields.first() == Some(&name))
    }

    /// Who asks; with the groups of the files, not of the session. `None` where the system does not know that user.
    pub fn asker(&self) -> Option<User> {
        let uid = self.uid.to_string();
        self.find_user(|fields| fields.get(2) == Some(&uid.as_str()))
    }

    fn find_user(&self, is_wanted: impl Fn(&[&str]) -> bool) -> Option<User> {
        let text = self.read("/etc/passwd")?;
        let fields = text.lines().map(|line| line.split(':').collect::<Vec<_>>());
        let found = fields.into_iter().find(|fields| is_wanted(fields))?;
        let name = (*found.first()?).to_owned();
        let mut gids = vec![found.get(3)?.parse().ok()?];
        let groups = self.read("/etc/group").unwrap_or_default();
        for line in groups.lines() {
            let fields: Vec<&str> = line.split(':').collect();
            let is_member =
                fields.get(3).is_some_and(|members| members.split(',').any(|member| member == name));
            gids.extend(fields.get(2).filter(|_| is_member).and_then(|gid| gid.parse::<u32>().ok()));
        }
        Some(User { uid: found.get(2)?.parse().ok()?, name, gids })
    }

    /// Who opens the cameras and writes the state: the service's user where there is one, else who asks.
    pub fn daemon_user(&self) -> User {
        self.user(SERVICE).unwrap_or_else(|| User {
            name: self.asker().map_or_else(|| self.uid.to_string(), |user| user.name),
            uid: self.uid,
            gids: self.gids.clone(),
        })
    }
}

impl User {
    /// Whether the user may read and write, by owner, group and mode.
    pub fn may_use(&self, rights: Rights) -> bool {
        let wanted = if self.uid == rights.uid {
            0o600
        } else if self.gids.contains(&rights.gid) {
            0o060
        } else {
            0o006
        };
        self.uid == 0 || rights.mode & wanted == wanted
    }
}

fn space(path: &Path) -> Option<Space> {
    let found = rustix::fs::statvfs(path).ok()?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
    Some(Space { free: bytes(found.f_bavail), total: bytes(found.f_blocks) })
}
