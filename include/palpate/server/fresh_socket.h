#pragma once

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

namespace palpate::server {

/// Configures a TCP socket for data that are outdated when they arrive late: small messages are sent
/// immediately, little unsent data wait in the kernel, and an interrupted network is tried again at least
/// once a second. Without the latter the kernel doubles its waiting time with each attempt, up to two
/// minutes, so that data would begin to flow again only after an interruption has lasted twice as long.
/// Failures are ignored: only latency depends on these options, and kernels before Linux 6.15 lack the last
/// one.
/// @param buffer_bytes  data that the kernel holds for the peer, sent or not (SO_SNDBUF)
inline void set_low_latency_options(int socket, int buffer_bytes) {
  constexpr int kMaxUnsent_bytes = 2 << 10;
  constexpr int kMaxRetransmission = 44, kMaxRetransmission_ms = 1000;  // TCP_RTO_MAX_MS
  const int on = 1;
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  ::setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &buffer_bytes, sizeof buffer_bytes);
  ::setsockopt(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &kMaxUnsent_bytes, sizeof kMaxUnsent_bytes);
  ::setsockopt(socket, IPPROTO_TCP, kMaxRetransmission, &kMaxRetransmission_ms, sizeof kMaxRetransmission_ms);
}

}  // namespace palpate::server
