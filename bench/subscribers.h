#pragma once

#include <cstdint>
#include <vector>

/// Subscribers of a published session, as programs on other machines' screens are.
namespace palpate::bench {

/// Messages that subscribers of one protocol received.
struct Received {
  std::uint64_t messages = 0;   ///< Poses and forces of ROS 2, ProbeToRAS of OpenIGTLink
  std::vector<double> ages_ms;  ///< Age of each pose, from its stamp to the receipt
  void add(const Received& other);
};

/// Receives the frames of an OpenIGTLink server on loopback.
/// @return at the deadline (steady_ns()), or when the server closes the connection
Received receive_openigtlink_until(int port, std::int64_t until_ns);

/// Receives measured_cp and measured_cf of the first hand, as a node of ROS 2 on Fast DDS.
/// @return at the deadline
Received receive_ros2_until(int domain, std::int64_t until_ns);

}  // namespace palpate::bench
