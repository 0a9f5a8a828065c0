//! What the service manager (systemd) is told, after sd_notify(3): datagrams of `KEY=value` lines to the socket that `NOTIFY_SOCKET`
//! names. Without that variable nothing is sent. Nothing here fails: a service whose manager does not listen runs all the same.

use std::ffi::OsString;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

/// Something to tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notice<'a> {
    /// The service does what it is there for; also the end of a reload.
    Ready,
    /// The config is being read anew.
    Reloading,
    /// The end has begun.
    Stopping,
    /// Everything moves.
    Watchdog,
    /// The start takes longer, at least so long from now on.
    StartingFor(Duration),
    /// One line for `systemctl status`.
    Status(&'a str),
}

/// The way to the service manager, if there is one.
#[derive(Debug, Default)]
pub struct ServiceManager {
    socket: Option<(UnixDatagram, SocketAddr)>,
    watchdog: Option<Duration>,
}

impl ServiceManager {
    /// As the environment says.
    pub fn from_environment() -> Self {
        let variable = |name: &str| std::env::var_os(name);
        Self { socket: variable("NOTIFY_SOCKET").and_then(open), watchdog: watchdog(variable) }
    }

    /// How long the manager waits for a sign of life before it ends the service; `None` when it does not watch.
    pub fn watchdog(&self) -> Option<Duration> {
        self.watchdog.filter(|_| self.socket.is_some())
    }

    /// Tells something.
    pub fn tell(&self, notice: Notice<'_>) {
        if let Some((socket, address)) = &self.socket {
            // The manager may be about to end itself; the service goes on.
            let _ = socket.send_to_addr(notice.text().as_bytes(), address);
        }
    }
}

impl Notice<'_> {
    fn text(self) -> String {
        match self {
            Notice::Ready => "READY=1".to_owned(),
            Notice::Reloading => format!("RELOADING=1\nMONOTONIC_USEC={}", monotonic_us()),
            Notice::Stopping => "STOPPING=1".to_owned(),
            Notice::Watchdog => "WATCHDOG=1".to_owned(),
            Notice::StartingFor(time) => format!("EXTEND_TIMEOUT_USEC={}", time.as_micros()),
            // A second line would be another assignment.
            Notice::Status(words) => format!("STATUS={}", words.replace('\n', " ")),
        }
    }
}

/// A path, or with `@` in front a name in the abstract namespace.
fn open(name: OsString) -> Option<(UnixDatagram, SocketAddr)> {
    let address = match name.as_bytes() {
        [b'@', abstract_name @ ..] => SocketAddr::from_abstract_name(abstract_name),
        _ => SocketAddr::from_pathname(&name),
    };
    let socket = UnixDatagram::unbound().ok()?;
    // A manager that does not read must not hold up the service.
    socket.set_nonblocking(true).ok()?;
    Some((socket, address.ok()?))
}

/// `WATCHDOG_USEC`, unless `WATCHDOG_PID` says that another process is meant.
fn watchdog(variable: impl Fn(&str) -> Option<OsString>) -> Option<Duration> {
    let number = |name: &str| variable(name)?.to_str()?.parse::<u64>().ok();
    let is_meant =
        variable("WATCHDOG_PID").is_none() || number("WATCHDOG_PID") == Some(std::process::id().into());
    let interval = number("WATCHDOG_USEC").filter(|us| *us > 0).map(Duration::from_micros);
    interval.filter(|_| is_meant)
}

fn monotonic_us() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec * 1_000_000 + now.tv_nsec / 1_000
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notices_reach_a_socket_by_path_and_by_abstract_name() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("notify");
        let name = format!("pelical-test-{}", std::process::id());
        let by_path = UnixDatagram::bind(&path).expect("bound");
        let address = SocketAddr::from_abstract_name(&name).expect("short enough");
        let by_name = UnixDatagram::bind_addr(&address).expect("bound");
        for (listener, variable) in [(by_path, path.into_os_string()), (by_name, format!("@{name}").into())] {
            let manager = ServiceManager { socket: open(variable), watchdog: None };
            manager.tell(Notice::Status("two\nlines"));
            let mut buffer = [0; 100];
            let length = listener.recv(&mut buffer).expect("a datagram");
            assert_eq!(&buffer[..length], b"STATUS=two lines");
        }
    }

    #[test]
    fn reloading_says_when_it_began() {
        let before = monotonic_us();
        let text = Notice::Reloading.text();
        let (head, stamp) = text.split_once("\nMONOTONIC_USEC=").expect("two lines");
        assert_eq!(head, "RELOADING=1");
        assert!((before..=monotonic_us()).contains(&stamp.parse().expect("a number")));
        assert_eq!(Notice::StartingFor(Duration::from_secs(2)).text(), "EXTEND_TIMEOUT_USEC=2000000");
    }

    #[test]
    fn a_watchdog_is_for_the_process_that_is_meant() {
        let own = std::process::id().to_string();
        let watched = |usec: &str, pid: Option<&str>| {
            watchdog(|name| match name {
                "WATCHDOG_USEC" => Some(usec.into()),
                _ => pid.map(OsString::from),
            })
        };
        assert_eq!(watched("2000000", Some(&own)), Some(Duration::from_secs(2)));
        assert_eq!(watched("2000000", None), Some(Duration::from_secs(2)));
        assert_eq!(watched("2000000", Some("1")), None);
        assert_eq!(watched("0", None), None);
        assert_eq!(watched("soon", None), None);
    }

    #[test]
    fn without_a_manager_nothing_is_watched_or_sent() {
        let manager = ServiceManager { socket: None, watchdog: Some(Duration::from_secs(1)) };
        assert_eq!(manager.watchdog(), None);
        manager.tell(Notice::Ready);
    }
}
