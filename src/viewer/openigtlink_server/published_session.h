#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/openigtlink/encoding.h"
#include "palpate/server/viewer_host.h"

namespace palpate::openigtlink_server {

using Message = std::shared_ptr<const igtl::MessageBytes>;

// names of the published messages; those of the second device and later have its number: "Probe2ToRAS"
inline constexpr const char* kLabelsName = "Labels";
inline constexpr const char* kSliceName = "Slice";

/// Names of the structures in contact with each device, as last sent to a client; empty: not sent yet.
using Structures = std::array<std::optional<std::string>, kMaxDevices>;

/// Time stamp of a message, from the system's clock.
std::uint64_t stamp_now();

/// Encodes what a session shows. Points and vectors are in RAS, forces in N.
class PublishedSession {
 public:
  explicit PublishedSession(const ViewerHost& host);

  /// Pose, force and force arrow of each device in the latest tick, and the structure of each device in
  /// contact if it differs from the one in `structures`, which is updated.
  igtl::MessageBytes frame(Structures& structures) const;
  /// STATUS: OK, or emergency while the force is stopped.
  Message status() const;
  /// Whether the force is stopped.
  bool is_stopped() const;
  /// Index of the axial slice of the grid next to the first device's tip; empty if the tip is outside.
  std::optional<int> slice_index() const;
  /// IMAGE of that slice: the scan's values, or the labels if there is no scan.
  Message slice(int index) const;
  /// IMAGE of all labels, or of the box in which they differ from an earlier version; null: nowhere.
  /// Thread-safe; may take long.
  /// @param before  version that the client has; null: none
  static Message labels(const Bricks<LabelId>& labels, const Bricks<LabelId>* before);
  Message label_list() const;
  Message image_list() const;

 private:
  const ViewerHost& host_;
  Eigen::Matrix3d R_WorldPatient_;
};

}  // namespace palpate::openigtlink_server
