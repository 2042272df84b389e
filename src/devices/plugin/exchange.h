#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "palpate_driver.h"

/// Messages between a session and the process of a plug-in, over a SOCK_SEQPACKET socket. Both run the same
/// program.
namespace palpate::plugin {

/// Descriptors of the plug-in's process: its end of the socket, and of the pipe that receives halts' numbers.
inline constexpr int kSocketFile = 3, kHaltFile = 4;

struct Request {
  enum class Kind : std::uint32_t { kLoad, kOpen, kRead, kWrite, kClose };
  Kind kind = Kind::kLoad;
  std::int32_t may_move = 0;      ///< kOpen
  std::uint64_t number = 0;       ///< kRead: repeated in the reply
  std::uint64_t halts_ended = 0;  ///< kWrite: halts with greater numbers are in force
  std::array<plp_driver_command, PLP_DRIVER_MAX_DEVICES> commands{};
};

/// Reply to kRead.
struct Samples {
  std::uint64_t number = 0;
  std::int32_t is_read = 0;  ///< 0: read() or the last write() failed
  std::int32_t reserved = 0;
  std::array<plp_driver_sample, PLP_DRIVER_MAX_DEVICES> samples{};
};

/// Reply to kLoad and kOpen.
struct Devices {
  std::int32_t is_ready = 0;  ///< 0: `error` has the reason
  std::uint32_t count = 0;
  std::array<char, 512> error{};
  std::array<plp_driver_device, PLP_DRIVER_MAX_DEVICES> devices{};
};

}  // namespace palpate::plugin
