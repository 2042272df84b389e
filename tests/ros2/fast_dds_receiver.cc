#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "fast_dds_node.h"

// Node of ROS 2 that subscribes to every topic of the first hand and of the session, until it is killed. It
// prints a line for each pose and each transform: "cp" or "tf", the message's stamp and the time of receipt,
// both of the system's clock, ns.
//
//     fast_dds_receiver DOMAIN ADDRESS

namespace {

std::int64_t now_ns() {
  using namespace std::chrono;
  return duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
}

}  // namespace

int main(int argc, char** argv) {
  using palpate::fast_dds::Cdr;
  using palpate::fast_dds::message_type;
  using palpate::fast_dds::Node;
  if (argc != 3) return 2;
  Node node(std::atoi(argv[1]), argv[2]);
  auto* const poses =
      node.subscribe("rt/palpate/hand1/measured_cp", message_type("geometry_msgs", "PoseStamped"), false);
  auto* const transforms = node.subscribe("rt/tf", message_type("tf2_msgs", "TFMessage"), true);
  node.subscribe("rt/palpate/hand1/measured_cv", message_type("geometry_msgs", "TwistStamped"), false);
  node.subscribe("rt/palpate/hand1/measured_cf", message_type("geometry_msgs", "WrenchStamped"), false);
  node.subscribe("rt/palpate/hand1/setpoint_cp", message_type("geometry_msgs", "PoseStamped"), false);
  node.subscribe("rt/palpate/hand1/distances", message_type("palpate_msgs", "Distances"), false);
  node.subscribe("rt/palpate/scene", message_type("std_msgs", "String"), true, true);
  node.subscribe("rt/tf_static", message_type("tf2_msgs", "TFMessage"), true, true);
  node.subscribe("rt/diagnostics", message_type("diagnostic_msgs", "DiagnosticArray"), true);
  while (true) {
    // poses come more often than anything else: waiting for them delays no transform by more
    if (auto pose = Node::next(poses, std::chrono::milliseconds(20)))
      std::printf("cp %lld %lld\n", static_cast<long long>(Cdr(*std::move(pose)).time_ns()),
                  static_cast<long long>(now_ns()));
    while (auto transform = Node::next(transforms, std::chrono::nanoseconds(0))) {
      Cdr message(*std::move(transform));
      message.read<std::uint32_t>();  // number of transforms
      std::printf("tf %lld %lld\n", static_cast<long long>(message.time_ns()),
                  static_cast<long long>(now_ns()));
    }
    if (std::fflush(stdout) != 0) return 1;
  }
}
