#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

/// Encoding of OpenIGTLink messages (openigtlink.org) with headers of version 1, which clients of every
/// version read. Lengths in mm.
namespace palpate::igtl {

using MessageBytes = std::vector<std::uint8_t>;

/// Name of a message, of which clients receive the first 20 bytes, and its time.
struct Title {
  std::string_view name;
  std::uint64_t stamp = 0;  ///< PoseMessage::stamp
};

/// TRANSFORM: a pose, or a vector as its translation.
MessageBytes transform_message(const Title& title, const Eigen::Matrix3d& rotation,
                               const Eigen::Vector3d& translation);
/// STRING in UTF-8, up to 65 535 bytes. Clients that use version 1.11 of the protocol's library read beyond
/// the end of an empty string.
MessageBytes string_message(const Title& title, std::string_view text);
/// POLYDATA of one line between two points.
MessageBytes line_message(const Title& title, const Eigen::Vector3d& from_mm, const Eigen::Vector3d& to_mm);

/// Codes of a STATUS message.
enum class StatusCode : std::uint16_t { kOk = 1, kEmergency = 3, kNotFound = 4 };
MessageBytes status_message(const Title& title, StatusCode code, std::string_view text);

/// Types of an image's voxels, with the codes of the protocol.
enum class VoxelType : std::uint8_t { kUint16 = 5, kFloat32 = 10 };
/// Grid of an image.
struct ImageGrid {
  std::array<std::uint16_t, 3> dims{1, 1, 1};
  /// Columns: steps between neighbouring voxels along i, j, k
  Eigen::Matrix3d steps_mm = Eigen::Matrix3d::Identity();
  Eigen::Vector3d first_mm = Eigen::Vector3d::Zero();  ///< Centre of voxel (0, 0, 0)
};
/// Box of an image that a message contains; the image's other voxels are unchanged.
struct SubVolume {
  std::array<std::uint16_t, 3> first{0, 0, 0}, dims{1, 1, 1};
};
/// IMAGE with coordinates in RAS. The message contains the centre of the image rather than the first voxel's.
/// @param voxels  little-endian, i fastest, of the dimensions of `part`
MessageBytes image_message(const Title& title, const ImageGrid& grid, const SubVolume& part, VoxelType type,
                           std::span<const std::uint8_t> voxels);
/// The same of the whole image.
MessageBytes image_message(const Title& title, const ImageGrid& grid, VoxelType type,
                           std::span<const std::uint8_t> voxels);

/// Entry of a LBMETA message: a label of a label image.
struct ListedLabel {
  std::string_view name;   ///< Up to 64 bytes
  std::string_view image;  ///< Name of the image that contains it
  std::uint8_t value = 0;
  std::array<std::uint8_t, 4> rgba{};
  std::array<std::uint16_t, 3> dims{1, 1, 1};
};
/// LBMETA: list of the labels that a client may request.
MessageBytes label_list_message(const Title& title, std::span<const ListedLabel> labels);

/// Entry of an IMGMETA message.
struct ListedImage {
  std::string_view name;
  std::string_view modality;  ///< As in DICOM
  std::array<std::uint16_t, 3> dims{1, 1, 1};
  VoxelType type = VoxelType::kFloat32;
};
/// IMGMETA: list of the images that a client may request, without a patient's name.
MessageBytes image_list_message(const Title& title, std::span<const ListedImage> images);

/// First message of a client: a STATUS (OK) of version 2, which tells the server that it may use that
/// version.
MessageBytes greeting();

}  // namespace palpate::igtl
