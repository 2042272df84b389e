#include <gtest/gtest.h>
#include <igtlClientSocket.h>
#include <igtlImageMessage.h>
#include <igtlImageMetaMessage.h>
#include <igtlLabelMetaMessage.h>
#include <igtlMessageHeader.h>
#include <igtlPolyDataMessage.h>
#include <igtlStatusMessage.h>
#include <igtlStringMessage.h>
#include <igtlTransformMessage.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <string>

#include "palpate/base/check.h"
#include "palpate/openigtlink_server/openigtlink_server.h"
#include "server/test_host.h"

// Every published message, received by the client socket and the message classes of OpenIGTLink's own library
// (Debian's libopenigtlink-dev), which check its size and its checksum.
namespace palpate {
namespace {

constexpr int kPatience_ms = 20'000;
constexpr int kCheckCrc = 1;

/// Published session with an oblique grid of anisotropic voxels under the tip, (1, 2, 3) LPS.
struct Publishing {
  Publishing() {
    grid.dims = {6, 5, 4};
    grid.spacing_mm = {0.5, 0.75, 2};
    grid.direction = (Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, -1).normalized())).toRotationMatrix();
    grid.origin = Point<Patient>(Eigen::Vector3d(1, 2, 3) - grid.direction * Eigen::Vector3d(1, 1.5, 2));
    auto scan = std::make_shared<Volume<float>>(grid);
    for (std::size_t v = 0; v < grid.voxel_count(); ++v) scan->voxels()[v] = static_cast<float>(v) - 7.5F;
    Volume<LabelId> labels(grid);
    labels.at(4, 1, 3) = 2;
    host.edit_scene().scan = scan;
    host.edit_scene().labels = label_bricks(labels);
    DeviceTick touching;
    touching.label = 1;
    touching.force_N = {0.5, -0.25, 1};
    host.bring_near(touching);
    OpenIgtLinkOptions options;
    options.port = 0;
    auto started = OpenIgtLinkServer::start(host, options);
    PALPATE_CHECK(started.ok());
    server = *std::move(started);
  }

  testing::FakeHost host;
  GridGeometry grid;
  std::unique_ptr<OpenIgtLinkServer> server;
};

class Client {
 public:
  explicit Client(int port) {
    EXPECT_EQ(socket_->ConnectToServer("127.0.0.1", port), 0);
    socket_->SetReceiveTimeout(kPatience_ms);
    socket_->SetSendTimeout(kPatience_ms);
  }
  ~Client() { socket_->CloseSocket(); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void ask(igtl::MessageBase& message) {
    message.Pack();
    EXPECT_NE(socket_->Send(message.GetPackPointer(), message.GetPackSize()), 0);
  }
  /// Next message of a type and name, unpacked; skips others.
  template <class Message>
  typename Message::Pointer next(const std::string& type, const std::string& name) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatience_ms);
    while (std::chrono::steady_clock::now() < until) {
      const igtl::MessageHeader::Pointer head = igtl::MessageHeader::New();
      head->InitPack();
      if (socket_->Receive(head->GetPackPointer(), head->GetPackSize()) != head->GetPackSize()) break;
      head->Unpack();
      if (type != head->GetDeviceType() || name != head->GetDeviceName()) {
        socket_->Skip(head->GetBodySizeToRead(), 0);
        continue;
      }
      typename Message::Pointer message = Message::New();
      message->SetMessageHeader(head);
      message->AllocatePack();
      const int size = message->GetPackBodySize();
      if (socket_->Receive(message->GetPackBodyPointer(), size) != size) break;
      EXPECT_EQ(message->Unpack(kCheckCrc) & igtl::MessageHeader::UNPACK_BODY,
                static_cast<int>(igtl::MessageHeader::UNPACK_BODY))
          << type << " " << name;
      return message;
    }
    ADD_FAILURE() << "no " << type << " " << name;
    return Message::New();
  }

 private:
  const igtl::ClientSocket::Pointer socket_ = igtl::ClientSocket::New();
};

TEST(OpenIgtLinkLibrary, ReceivesPoseForceArrowAndTexts) {
  Publishing publishing;
  Client client(publishing.server->port());
  igtl::Matrix4x4 matrix;
  client.next<igtl::TransformMessage>("TRANSFORM", "ProbeToRAS")->GetMatrix(matrix);
  // (1, 2, 3) LPS
  for (const auto& [row, mm] : {std::pair(0, -1.0F), std::pair(1, -2.0F), std::pair(2, 3.0F)})
    EXPECT_EQ(matrix[row][3], mm);
  client.next<igtl::TransformMessage>("TRANSFORM", "Force")->GetMatrix(matrix);
  EXPECT_NEAR(std::hypot(matrix[0][3], matrix[1][3], matrix[2][3]), std::hypot(0.5, 0.25, 1), 1e-6);

  const auto arrow = client.next<igtl::PolyDataMessage>("POLYDATA", "ForceArrow");
  ASSERT_EQ(arrow->GetPoints()->GetNumberOfPoints(), 2);
  std::array<igtlFloat32, 3> tip, end;
  arrow->GetPoints()->GetPoint(0, tip.data());
  arrow->GetPoints()->GetPoint(1, end.data());
  EXPECT_EQ(tip, (std::array<igtlFloat32, 3>{-1, -2, 3}));
  for (std::size_t axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(end[axis] - tip[axis], kForceArrow_mm_per_N * matrix[axis][3], 1e-4);
  EXPECT_EQ(arrow->GetLines()->GetNumberOfCells(), 1u);

  Client another(publishing.server->port());
  EXPECT_STREQ(another.next<igtl::StatusMessage>("STATUS", "palpate")->GetStatusString(), "force enabled");
  EXPECT_STREQ(another.next<igtl::StringMessage>("STRING", "Structure")->GetString(), "femur");
  publishing.host.emergency_stop({});
  EXPECT_EQ(another.next<igtl::StatusMessage>("STATUS", "palpate")->GetCode(),
            static_cast<int>(igtl::StatusMessage::STATUS_PANICK_MODE));
}

/// Value of an image's voxel at a position in RAS; -1: outside.
template <class Value>
double value_at(igtl::ImageMessage& image, const Eigen::Vector3d& ras_mm) {
  int dims[3];
  image.GetDimensions(dims);
  igtl::Matrix4x4 matrix;  // unit columns; the origin is the centre
  image.GetMatrix(matrix);
  float spacing_mm[3];
  image.GetSpacing(spacing_mm);
  Eigen::Matrix3d steps;
  Eigen::Vector3d centre;
  for (int row = 0; row < 3; ++row) {
    centre[row] = matrix[row][3];
    for (int column = 0; column < 3; ++column) steps(row, column) = matrix[row][column] * spacing_mm[column];
  }
  Eigen::Vector3d voxel = steps.inverse() * (ras_mm - centre);
  std::size_t offset = 0;
  for (int axis = 2; axis >= 0; --axis) {
    const long at = std::lround(voxel[axis] + 0.5 * (dims[axis] - 1));
    if (at < 0 || at >= dims[axis]) return -1;
    offset = offset * static_cast<std::size_t>(dims[axis]) + static_cast<std::size_t>(at);
  }
  Value value;
  std::memcpy(&value, static_cast<const char*>(image.GetScalarPointer()) + offset * sizeof value,
              sizeof value);
  return value;
}

TEST(OpenIgtLinkLibrary, FindsALabelAtItsPlace) {
  Publishing publishing;
  Client client(publishing.server->port());
  const auto ask_for = [&client](const char* name) {
    const auto get_image = igtl::GetImageMessage::New();
    get_image->SetDeviceName(name);
    client.ask(*get_image);
  };
  ask_for("Labels");
  const auto labels = client.next<igtl::ImageMessage>("IMAGE", "Labels");
  EXPECT_EQ(labels->GetScalarType(), static_cast<int>(igtl::ImageMessage::TYPE_UINT16));
  EXPECT_EQ(labels->GetCoordinateSystem(), static_cast<int>(igtl::ImageMessage::COORDINATE_RAS));
  // sent at the beginning, and again when asked for
  ask_for("Slice");
  const auto slice = client.next<igtl::ImageMessage>("IMAGE", "Slice");
  EXPECT_EQ(slice->GetScalarType(), static_cast<int>(igtl::ImageMessage::TYPE_FLOAT32));
  const Volume<float>& scan = *publishing.host.scene().scan;
  int in_slice = 0;
  for (int k = 0; k < publishing.grid.dims[2]; ++k)
    for (int j = 0; j < publishing.grid.dims[1]; ++j)
      for (int i = 0; i < publishing.grid.dims[0]; ++i) {
        const Eigen::Vector3d lps = (publishing.grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen();
        const Eigen::Vector3d ras(-lps.x(), -lps.y(), lps.z());
        EXPECT_EQ(value_at<std::uint16_t>(*labels, ras), (i == 4 && j == 1 && k == 3 ? 2 : 0));
        const double value = value_at<float>(*slice, ras);
        if (k == 1) {
          EXPECT_EQ(value, scan.at(i, j, k));
        }
        in_slice += value != -1 ? 1 : 0;
      }
  EXPECT_EQ(in_slice, 6 * 5) << "only those of the slice under the tip";
}

TEST(OpenIgtLinkLibrary, ReceivesTheListsOfLabelsAndImages) {
  Publishing publishing;
  Client client(publishing.server->port());
  client.ask(*igtl::GetLabelMetaMessage::New());
  const auto list = client.next<igtl::LabelMetaMessage>("LBMETA", "palpate");
  ASSERT_EQ(list->GetNumberOfLabelMetaElement(), 2);
  igtl::LabelMetaElement::Pointer label;
  list->GetLabelMetaElement(1, label);
  EXPECT_STREQ(label->GetName(), "tibia");
  EXPECT_STREQ(label->GetDeviceName(), "Labels");
  EXPECT_EQ(label->GetLabel(), 2);
  igtlUint8 rgba[4];
  label->GetRGBA(rgba);
  EXPECT_EQ(std::to_array(rgba), (std::array<igtlUint8, 4>{10, 20, 30, 255}));

  client.ask(*igtl::GetImageMetaMessage::New());
  const auto images = client.next<igtl::ImageMetaMessage>("IMGMETA", "palpate");
  ASSERT_EQ(images->GetNumberOfImageMetaElement(), 1);
  igtl::ImageMetaElement::Pointer image;
  images->GetImageMetaElement(0, image);
  EXPECT_STREQ(image->GetName(), "Slice");
  EXPECT_STREQ(image->GetModality(), "CT");
  EXPECT_STREQ(image->GetPatientID(), "");
}

}  // namespace
}  // namespace palpate
