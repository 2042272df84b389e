#pragma once

#include <functional>
#include <memory>
#include <string>

#include "palpate/base/result.h"
#include "palpate/server/viewer_host.h"

/// Publishes a session to nodes of ROS 2, without ROS 2: by DDS, under the topic and type names that its
/// middleware uses, with the names of CRTK (collaborative robotics toolkit). docs/guide/ros2.md lists the
/// topics. A node can stop the force, and move the tip of a session whose input is "ros2"; nothing else that
/// it sends changes the session.
namespace palpate {

struct Ros2Options {
  int domain = 0;         ///< ROS_DOMAIN_ID, 0 ... 101
  std::string interface;  ///< Name or address of the network interface; empty: loopback
  double rate_hz = 250;   ///< Rate of poses and forces; Hz, 1 ... 1000
};

/// Publishes until it is destroyed, on one thread of ordinary priority.
class Ros2Publisher {
 public:
  /// @param host  outlives the publisher
  /// Errors: kUsage if the scene offers tasks, whose hidden structures a node would see; kBadInput for a
  /// domain or rate out of range; kUnavailable without Cyclone DDS, and for an interface that is not there.
  static Result<std::unique_ptr<Ros2Publisher>> start(ViewerHost& host, const Ros2Options& options);
  virtual ~Ros2Publisher() = default;
};

}  // namespace palpate
