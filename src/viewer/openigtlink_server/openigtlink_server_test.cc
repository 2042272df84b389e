#include "palpate/openigtlink_server/openigtlink_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "base/test_seed.h"
#include "palpate/base/check.h"
#include "palpate/openigtlink/encoding.h"
#include "palpate/openigtlink/messages.h"
#include "server/test_host.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using std::chrono::milliseconds;
using testing::FakeHost;

// ---- a client with a decoder of its own, written from the protocol's specification

std::uint64_t number(const Bytes& bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t n = 0; n < count; ++n) value = value << 8 | bytes.at(at + n);
  return value;
}
double real(const Bytes& bytes, std::size_t at) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(number(bytes, at, 4)));
}
std::string text(const Bytes& bytes, std::size_t at, std::size_t count) {
  std::string out(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                  bytes.begin() + static_cast<std::ptrdiff_t>(at + count));
  return out.substr(0, out.find('\0'));
}
// bit by bit, without a table
std::uint64_t slow_crc64(const Bytes& bytes) {
  std::uint64_t crc = 0;
  for (const std::uint8_t byte : bytes)
    for (int bit = 7; bit >= 0; --bit) {
      const bool carry = (crc >> 63 & 1) != static_cast<std::uint64_t>(byte >> bit & 1);
      crc = crc << 1 ^ (carry ? 0x42F0E1EBA9EA3693 : 0);
    }
  return crc;
}

struct Received {
  std::string type, name;
  std::uint64_t version = 0, stamp = 0;
  Bytes body;
};

class Client {
 public:
  explicit Client(int port, int receive_buffer = 0)
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    if (receive_buffer > 0)
      ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    PALPATE_CHECK(::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0);
  }
  ~Client() { ::close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void send(const Bytes& bytes) {
    // the server may have closed the connection
    (void)::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }
  void ask(const char* type, const char* name) {
    Bytes head(igtl::kHeader_bytes, 0);
    head[1] = 1;
    std::memcpy(head.data() + 2, type, std::strlen(type));
    std::memcpy(head.data() + 14, name, std::strlen(name));
    send(head);
  }
  /// Next message; fails the test after ten seconds without one, or if its checksum is wrong.
  Received next() {
    const Bytes head = read(igtl::kHeader_bytes);
    if (head.empty()) return {};
    Received out{text(head, 2, 12), text(head, 14, 20), number(head, 0, 2), number(head, 34, 8), {}};
    out.body = read(number(head, 42, 8));
    EXPECT_EQ(slow_crc64(out.body), number(head, 50, 8)) << out.type;
    return out;
  }
  /// Next message of a name.
  Received next(const std::string& name) {
    for (;;) {
      Received message = next();
      if (message.type.empty() || message.name == name) return message;
    }
  }
  /// Whether the server closes the connection within some seconds.
  bool is_closed() {
    Bytes buffer(4096);
    for (int tries = 0; tries < 1000; ++tries) {
      pollfd waiting{socket_, POLLIN, 0};
      if (::poll(&waiting, 1, 10'000) <= 0) return false;
      if (::recv(socket_, buffer.data(), buffer.size(), 0) <= 0) return true;
    }
    return false;
  }

 private:
  Bytes read(std::size_t bytes) {
    Bytes out(bytes);
    for (std::size_t had = 0; had < bytes;) {
      pollfd waiting{socket_, POLLIN, 0};
      const bool ready = ::poll(&waiting, 1, 10'000) > 0;
      const ssize_t received = ready ? ::recv(socket_, out.data() + had, bytes - had, 0) : 0;
      if (received <= 0) {
        ADD_FAILURE() << "no message";
        return {};
      }
      had += static_cast<std::size_t>(received);
    }
    return out;
  }
  int socket_;
};

class Publishing {
 public:
  explicit Publishing(const std::function<void(FakeHost&)>& prepare = {}) {
    if (prepare) prepare(host);
    OpenIgtLinkOptions options;
    options.port = 0;
    options.rate_hz = 200;
    auto started = OpenIgtLinkServer::start(host, options);
    PALPATE_CHECK(started.ok());
    server = *std::move(started);
  }
  int port() const { return server->port(); }

  FakeHost host;
  std::unique_ptr<OpenIgtLinkServer> server;
};

DeviceTick touching() {
  DeviceTick device;
  device.label = 1;
  device.force_N = {0.5, -1, 2};
  const double half = std::sqrt(0.5);
  device.orientation_wxyz = {half, 0, 0, half};
  return device;
}

TEST(OpenIgtLinkServer, PublishesPoseForceArrowAndStructureInRas) {
  Publishing publishing;
  publishing.host.bring_near(touching());
  Client client(publishing.port());
  // the fake host's world: x, z, -y of the patient's axes; its tip is at (1, 2, 3) LPS
  const Received probe = client.next("ProbeToRAS");
  EXPECT_EQ(probe.type, "TRANSFORM");
  EXPECT_EQ(probe.version, 1u);
  ASSERT_EQ(probe.body.size(), 48u);
  EXPECT_EQ(real(probe.body, 36), -1);
  EXPECT_EQ(real(probe.body, 40), -2);
  EXPECT_EQ(real(probe.body, 44), 3);
  // the tool is turned by 90 degrees about the world's z: its x axis is the world's y, which is the patient's
  // z
  EXPECT_NEAR(real(probe.body, 0), 0, 1e-6);
  EXPECT_NEAR(real(probe.body, 4), 0, 1e-6);
  EXPECT_NEAR(std::abs(real(probe.body, 8)), 1, 1e-6);
  const double seconds = static_cast<double>(probe.stamp) / 4294967296.0;
  EXPECT_NEAR(seconds,
              std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(), 10);

  const Received force = client.next("Force");
  EXPECT_EQ(force.type, "TRANSFORM");
  const std::array<double, 3> force_N{real(force.body, 36), real(force.body, 40), real(force.body, 44)};
  EXPECT_NEAR(std::hypot(force_N[0], force_N[1], force_N[2]), std::hypot(0.5, 1, 2), 1e-5);
  EXPECT_NEAR(force_N[0], -0.5, 1e-6) << "x is the patient's x in this world, and RAS has the other sign";

  const Received arrow = client.next("ForceArrow");
  EXPECT_EQ(arrow.type, "POLYDATA");
  ASSERT_EQ(arrow.body.size(), 40u + 24 + 12);
  EXPECT_EQ(number(arrow.body, 0, 4), 2u) << "points";
  EXPECT_EQ(number(arrow.body, 12, 4), 1u) << "lines";
  EXPECT_EQ(number(arrow.body, 16, 4), 12u) << "bytes of the lines";
  for (std::size_t axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(real(arrow.body, 52 + 4 * axis) - real(arrow.body, 40 + 4 * axis),
                kForceArrow_mm_per_N * force_N[axis], 1e-5);
  EXPECT_EQ(number(arrow.body, 64, 4), 2u);
  EXPECT_EQ(number(arrow.body, 72, 4), 1u);
}

TEST(OpenIgtLinkServer, ReportsTheStructureOnceUntilItChanges) {
  Publishing publishing;
  publishing.host.bring_near(touching());
  Client client(publishing.port());
  std::map<std::string, int> counts;
  for (int n = 0; n < 40; ++n) {
    const Received message = client.next();
    if (message.type == "STRING") {
      EXPECT_EQ(number(message.body, 0, 2), 106u) << "UTF-8";
      EXPECT_EQ(text(message.body, 4, number(message.body, 2, 2)), "femur");
    }
    ++counts[message.name];
  }
  EXPECT_EQ(counts["Structure"], 1);
  EXPECT_EQ(counts["palpate"], 1) << "the status";
  EXPECT_GT(counts["ProbeToRAS"], 5);
  publishing.host.bring_near(DeviceTick{});
  const Received none = client.next("Structure");
  EXPECT_EQ(text(none.body, 4, number(none.body, 2, 2)), "none");
}

TEST(OpenIgtLinkServer, ReportsTheStructureToEachClientOnce) {
  Publishing publishing;
  publishing.host.bring_near(touching());
  Client first(publishing.port()), second(publishing.port());
  for (Client* client : {&first, &second}) EXPECT_EQ(client->next("Structure").type, "STRING");
  // the structures last sent to this client differ from those sent to the other two
  Client late(publishing.port());
  EXPECT_EQ(late.next("Structure").type, "STRING");
  for (Client* client : {&first, &second, &late}) {
    std::map<std::string, int> counts;
    for (int n = 0; n < 20; ++n) ++counts[client->next().name];
    EXPECT_EQ(counts["Structure"], 0);
    EXPECT_GT(counts["ProbeToRAS"], 2);
  }
}

TEST(OpenIgtLinkServer, SendsLabelsWhereTheyAreInRas) {
  Publishing publishing;
  Client client(publishing.port());
  client.ask("GET_LBMETA", "");
  Received list = client.next("palpate");
  if (list.type == "STATUS") list = client.next("palpate");
  ASSERT_EQ(list.type, "LBMETA");
  ASSERT_EQ(list.body.size(), 2u * 116);
  EXPECT_EQ(text(list.body, 116, 64), "tibia");
  EXPECT_EQ(text(list.body, 116 + 64, 20), "Labels");
  EXPECT_EQ(list.body[116 + 84], 2);

  client.ask("GET_IMAGE", "Labels");
  const Received image = client.next("Labels");
  const GridGeometry& grid = publishing.host.scene().labels->geometry();
  ASSERT_EQ(image.type, "IMAGE");
  ASSERT_EQ(image.body.size(), 72 + 2 * grid.voxel_count());
  EXPECT_EQ(image.body[3], 5) << "uint16";
  EXPECT_EQ(image.body[4], 2) << "little-endian";
  EXPECT_EQ(image.body[5], 1) << "RAS";
  // each voxel, found again by the message's own geometry
  std::array<std::array<double, 3>, 4> columns;
  for (std::size_t c = 0; c < 4; ++c)
    for (std::size_t r = 0; r < 3; ++r) columns[c][r] = real(image.body, 12 + 4 * (3 * c + r));
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const std::array<double, 3> from_centre{i - 0.5 * (grid.dims[0] - 1), j - 0.5 * (grid.dims[1] - 1),
                                                k - 0.5 * (grid.dims[2] - 1)};
        const Eigen::Vector3d lps = (grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen();
        for (std::size_t r = 0; r < 3; ++r) {
          double ras = columns[3][r];
          for (std::size_t c = 0; c < 3; ++c) ras += columns[c][r] * from_centre[c];
          EXPECT_NEAR(ras, (r < 2 ? -1 : 1) * lps[static_cast<int>(r)], 1e-4);
        }
        const std::size_t at = 72 + 2 * grid.offset(i, j, k);
        EXPECT_EQ(image.body[at] + 256 * image.body[at + 1], publishing.host.scene().labels->at(i, j, k));
      }
}

/// Voxels of an IMAGE of labels, applied to those received before.
void apply_labels(const Received& image, Volume<LabelId>& labels) {
  ASSERT_EQ(image.type, "IMAGE");
  std::array<int, 3> first, dims;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    ASSERT_EQ(number(image.body, 6 + 2 * axis, 2), static_cast<unsigned>(labels.geometry().dims[axis]));
    first[axis] = static_cast<int>(number(image.body, 60 + 2 * axis, 2));
    dims[axis] = static_cast<int>(number(image.body, 66 + 2 * axis, 2));
    ASSERT_LE(first[axis] + dims[axis], labels.geometry().dims[axis]);
  }
  std::size_t at = 72;
  for (int k = first[2]; k < first[2] + dims[2]; ++k)
    for (int j = first[1]; j < first[1] + dims[1]; ++j)
      for (int i = first[0]; i < first[0] + dims[0]; ++i, at += 2)
        labels.at(i, j, k) = static_cast<LabelId>(image.body.at(at) + 256 * image.body.at(at + 1));
  ASSERT_EQ(at, image.body.size());
}

// cuts at random places of a grid of many bricks; a client that joins later gets all labels first
TEST(OpenIgtLinkServer, SendsTheBoxesThatAreCutToThoseWhoFollow) {
  Publishing publishing([](FakeHost& host) {
    GridGeometry grid = host.scene().labels->geometry();
    grid.dims = {50, 45, 60};
    Volume<LabelId> labels(grid);
    for (std::size_t v = 0; v < grid.voxel_count(); ++v)
      labels.voxels()[v] = static_cast<LabelId>(1 + v / 7 % 300);
    host.edit_scene().scan = nullptr;
    host.edit_scene().labels = label_bricks(labels);
  });
  const auto seed = test::test_seed();
  std::mt19937_64 random(seed);
  auto labels = publishing.host.scene().labels;
  const std::size_t whole_bytes = 72 + 2 * labels->geometry().voxel_count();
  Client client(publishing.port());
  client.ask("STT_IMAGE", "Labels");
  Volume<LabelId> received(labels->geometry());
  const Received all = client.next("Labels");
  ASSERT_EQ(all.body.size(), whole_bytes);
  ASSERT_NO_FATAL_FAILURE(apply_labels(all, received));
  EXPECT_EQ(received.voxels(), labels->dense().voxels());
  for (int cut = 0; cut < 8; ++cut) {
    PatchOf<LabelId> patch;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      patch.box.size[axis] = 1 + static_cast<int>(random() % 5);
      const int rooms = labels->geometry().dims[axis] - patch.box.size[axis] + 1;
      patch.box.first[axis] = static_cast<int>(random() % static_cast<unsigned>(rooms));
    }
    patch.values.assign(patch.box.voxel_count(), 0);
    labels = std::make_shared<const Bricks<LabelId>>(labels->with(patch));
    publishing.host.cut(labels);
    const Received box = client.next("Labels");
    EXPECT_LT(box.body.size(), whole_bytes) << "seed " << seed;
    ASSERT_NO_FATAL_FAILURE(apply_labels(box, received));
    ASSERT_EQ(received.voxels(), labels->dense().voxels()) << "cut " << cut << ", seed " << seed;
  }
  Client later(publishing.port());
  later.ask("GET_IMAGE", "Labels");
  EXPECT_EQ(later.next("Labels").body.size(), whole_bytes);
  // an undo restores them
  publishing.host.cut(publishing.host.scene().labels);
  ASSERT_NO_FATAL_FAILURE(apply_labels(client.next("Labels"), received));
  EXPECT_EQ(received.voxels(), publishing.host.scene().labels->dense().voxels());
}

// moves the scene's grid under the fake host's tip, (1, 2, 3) LPS, which is then next to slice 1
void move_under_tip(FakeHost& host) {
  GridGeometry grid = host.scene().labels->geometry();
  grid.origin = Point<Patient>(0, 1, 0.5);
  auto scan = std::make_shared<Volume<float>>(grid);
  for (std::size_t v = 0; v < grid.voxel_count(); ++v) scan->voxels()[v] = static_cast<float>(v) - 7.5F;
  host.edit_scene().labels = label_bricks(Volume<LabelId>(grid));
  host.edit_scene().scan = scan;
}

TEST(OpenIgtLinkServer, SendsTheSliceUnderTheTip) {
  Publishing publishing(move_under_tip);
  Client client(publishing.port());
  const Received slice = client.next("Slice");
  const Volume<float>& scan = *publishing.host.scene().scan;
  const GridGeometry& grid = scan.geometry();
  ASSERT_EQ(slice.type, "IMAGE");
  ASSERT_EQ(slice.body.size(), 72u + 4 * 5 * 4);
  EXPECT_EQ(slice.body[3], 10) << "float32";
  const Eigen::Vector3d centre = (grid.X_PatientVoxel() * Point<Voxel>(2, 1.5, 1)).eigen();
  EXPECT_NEAR(real(slice.body, 48), -centre.x(), 1e-5);
  EXPECT_NEAR(real(slice.body, 52), -centre.y(), 1e-5);
  EXPECT_NEAR(real(slice.body, 56), centre.z(), 1e-5);
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 5; ++i) {
      float value = 0;
      std::memcpy(&value, slice.body.data() + 72 + 4 * (i + 5 * j), sizeof value);
      EXPECT_EQ(value, scan.at(i, j, 1));
    }

  client.ask("GET_IMGMETA", "");
  Received list = client.next("palpate");
  if (list.type == "STATUS") list = client.next("palpate");
  ASSERT_EQ(list.type, "IMGMETA");
  ASSERT_EQ(list.body.size(), 260u);
  EXPECT_EQ(text(list.body, 0, 64), "Slice");
  EXPECT_EQ(text(list.body, 84, 32), "CT");
  EXPECT_EQ(text(list.body, 116, 128), "") << "no patient's name or identifier";
}

TEST(OpenIgtLinkServer, ReportsAStop) {
  Publishing publishing;
  Client client(publishing.port());
  EXPECT_EQ(number(client.next("palpate").body, 0, 2), 1u) << "OK";
  publishing.host.emergency_stop({});
  const Received stopped = client.next("palpate");
  EXPECT_EQ(stopped.type, "STATUS");
  EXPECT_EQ(number(stopped.body, 0, 2), 3u) << "emergency";
}

TEST(OpenIgtLinkServer, StalledReadersDelayNoOtherClient) {
  Publishing publishing;
  // takes nothing
  Client silent(publishing.port(), 4096);
  silent.ask("STT_IMAGE", "Labels");
  Client client(publishing.port());
  const auto begin = std::chrono::steady_clock::now();
  for (int n = 0; n < 100; ++n) EXPECT_EQ(client.next("ProbeToRAS").type, "TRANSFORM");
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
  EXPECT_EQ(publishing.server->clients(), 2);
}

TEST(OpenIgtLinkServer, SurvivesGarbageAbruptClosesAndStatusOfVersion2) {
  Publishing publishing;
  const auto seed = test::test_seed();
  std::mt19937_64 random(seed);
  for (int n = 0; n < 60; ++n) {
    Client client(publishing.port());
    Bytes garbage = n % 3 == 0 ? igtl::greeting() : Bytes(1 + random() % 500);
    if (n % 3 != 0)
      for (auto& byte : garbage) byte = static_cast<std::uint8_t>(random());
    client.send(garbage);
    // as Slicer begins a connection
    if (n % 3 == 0) {
      EXPECT_EQ(client.next("ProbeToRAS").type, "TRANSFORM");
    }
  }
  Client wrong(publishing.port());
  wrong.send(Bytes(100, 0xff));
  EXPECT_TRUE(wrong.is_closed());
  Client client(publishing.port());
  EXPECT_EQ(client.next("ProbeToRAS").type, "TRANSFORM") << "seed " << seed;
}

TEST(OpenIgtLinkServer, RejectsInvalidOptions) {
  FakeHost host;
  OpenIgtLinkOptions options;
  options.port = 0;
  options.address = "localhost";
  EXPECT_EQ(OpenIgtLinkServer::start(host, options).error().kind, ErrorKind::kBadInput);
  options.address = "127.0.0.1";
  options.rate_hz = 0;
  EXPECT_EQ(OpenIgtLinkServer::start(host, options).error().kind, ErrorKind::kBadInput);
  options.rate_hz = 60;
  auto first = OpenIgtLinkServer::start(host, options);
  ASSERT_TRUE(first.ok());
  options.port = (*first)->port();
  EXPECT_EQ(OpenIgtLinkServer::start(host, options).error().kind, ErrorKind::kUnavailable);
  host.edit_scene().tasks.push_back(testing::test_task());
  EXPECT_EQ(OpenIgtLinkServer::start(host, options).error().kind, ErrorKind::kUsage);
}

}  // namespace
}  // namespace palpate
