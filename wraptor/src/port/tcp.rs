//! The options of every TCP socket, of hosts and of simulated hands.

use std::io;
use std::net::TcpStream;

/// Sets the options of a connection.
///
/// * Small pieces are sent at once.
/// * The kernel ends a connection whose peer answers nothing for 5 s (decision 0072): one that leaves without a FIN, by a pulled cable, a power
///   cut or a suspended machine, would block a server of one client at a time for hours. After 2 s without traffic the peer's kernel is asked
///   three times, a second apart. On Linux, data that are not acknowledged for 5 s end it too, also those of a program that does not
///   read and whose buffers are full.
/// * Urgent data stay in their place among the others: a Telnet client's mark behind Interrupt Process would be lost.
///
/// Elsewhere than on Unix only the first.
///
/// # Errors
/// The socket's: the peer has disconnected.
pub fn configure_tcp(stream: &TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    #[cfg(unix)]
    {
        use rustix::net::sockopt;
        use std::time::Duration;
        sockopt::set_socket_keepalive(stream, true)?;
        sockopt::set_tcp_keepidle(stream, Duration::from_secs(2))?;
        sockopt::set_tcp_keepintvl(stream, Duration::from_secs(1))?;
        sockopt::set_tcp_keepcnt(stream, 3)?;
        #[cfg(target_os = "linux")]
        sockopt::set_tcp_user_timeout(stream, 5000)?;
        sockopt::set_socket_oobinline(stream, true)?;
    }
    Ok(())
}

/// Whether bytes that have arrived hold an option of Telnet (RFC 854): IAC, WILL, WONT, DO or DONT, and a number. A device server sends them
/// first; neither a hand's text nor SLCAN has a byte above 127.
pub(crate) fn negotiates_telnet(bytes: &[u8]) -> bool {
    bytes.windows(2).any(|pair| matches!(pair, [255, 251..=254]))
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};
    use std::time::Duration;

    use super::super::Port;
    use crate::deadline::Deadline;

    /// A server whose machine vanishes: in repair mode (root) a socket closes without a FIN, and a killed one answers nothing but resets.
    const SERVER: &str = "
import socket, sys
listener = socket.create_server(('127.0.0.1', 0))
print(listener.getsockname()[1], flush=True)
peer, _ = listener.accept()
try:
    peer.setsockopt(socket.IPPROTO_TCP, 19, 1)
    print('vanished', flush=True)
except PermissionError:
    print('denied', flush=True)
peer.close()
sys.stdin.read()
";

    #[test]
    fn peer_that_vanishes_without_a_fin_is_gone() {
        let python =
            Command::new("python3").args(["-c", SERVER]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let Ok(mut python) = python else {
            println!("skipped: no python3 to close a socket without a FIN");
            return;
        };
        let mut lines = BufReader::new(python.stdout.take().expect("piped")).lines();
        let mut line = || lines.next().expect("a line").expect("text");
        let address = format!("127.0.0.1:{}", line());
        let mut port = Port::tcp(&address, &Deadline::after(Duration::from_secs(10))).expect("it listens");
        if line() == "denied" {
            println!("skipped: TCP_REPAIR needs root");
        } else {
            // Without keep-alive nothing arrives until this deadline.
            assert!(port.receive(&Deadline::after(Duration::from_secs(60))).is_err());
        }
        drop(python.stdin.take());
        python.wait().expect("it ends");
    }
}
