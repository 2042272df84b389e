#include "server/volume_pictures.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <future>
#include <numbers>

#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::testing::FakeHost;

/// A ball of the second structure in the centre of the volume, and nothing else.
struct BallHost : FakeHost {
  BallHost() : FakeHost({40, 40, 40}) {
    GridGeometry grid;
    grid.dims = {40, 40, 40};
    Volume<LabelId> labels(grid);
    for (int k = 0; k < 40; ++k)
      for (int j = 0; j < 40; ++j)
        for (int i = 0; i < 40; ++i)
          labels.at(i, j, k) = Eigen::Vector3d(i - 20, j - 20, k - 20).norm() < 12 ? 2 : 0;
    ball = scene();
    ball.scan = nullptr;
    ball.labels = label_bricks(labels);
  }
  const ViewedScene& scene() const override { return ball.labels ? ball : FakeHost::scene(); }
  std::shared_ptr<const Bricks<LabelId>> labels() const override {
    const std::lock_guard lock(mutex);
    return now ? now : ball.labels;
  }
  ViewedScene ball;
  mutable std::mutex mutex;
  std::shared_ptr<const Bricks<LabelId>> now;
};

/// View from the front with 48 x 48 pixels of 1 mm.
constexpr const char* kFront = "view=48,48,-4,20,44,1,0,0,0,0,-1";

std::shared_ptr<const std::string> wait_for(PictureStore& store, const std::string& query) {
  auto key = parse_picture_query(query, 2);
  if (!key) return nullptr;
  std::promise<PictureStore::Payload> promise;
  const auto requester = std::make_shared<int>(0);
  store.request(*key, requester,
                [&](PictureStore::Payload payload) { promise.set_value(std::move(payload)); });
  return promise.get_future().get();
}

struct Observed {
  explicit Observed(const std::string& payload)
      : bytes(payload),
        width(number_at<std::uint16_t>(payload, 8)),
        height(number_at<std::uint16_t>(payload, 10)) {}
  std::size_t pixel(int column, int row) const { return static_cast<std::size_t>(row * width + column); }
  std::size_t pixels() const { return static_cast<std::size_t>(width * height); }
  int red(int column, int row) const {
    return static_cast<unsigned char>(bytes[24 + 3 * pixel(column, row)]);
  }
  int structure_index(int column, int row) const { return bytes[24 + 5 * pixels() + pixel(column, row)]; }
  double depth_mm(int column, int row) const {
    const auto step = number_at<std::uint16_t>(bytes, 24 + 3 * pixels() + 2 * pixel(column, row));
    return number_at<float>(bytes, 12) + number_at<float>(bytes, 16) * step / 65535.0;
  }
  const std::string& bytes;
  int width, height;
};

TEST(PictureStore, DrawsTheSceneWithMetadata) {
  const BallHost host;
  PictureStore store(host);
  const auto payload = wait_for(store, kFront);
  ASSERT_NE(payload, nullptr);
  ASSERT_EQ(payload->substr(0, 4), "PLPV");
  const Observed observed(*payload);
  ASSERT_EQ(payload->size(), 24u + 6 * 48 * 48);
  int encountered = 0;
  for (int row = 0; row < 48; ++row)
    for (int column = 0; column < 48; ++column) {
      const double off = std::hypot(-4 + column + 0.5 - 20, 44 - row - 0.5 - 20);
      if (observed.structure_index(column, row) != 0) ++encountered;
      if (off > 13) {
        EXPECT_EQ(observed.structure_index(column, row), 0) << column << " " << row;
      }
      if (off > 11) continue;
      // the second structure, at the ball's surface
      EXPECT_EQ(observed.structure_index(column, row), 2) << column << " " << row;
      EXPECT_NEAR(observed.depth_mm(column, row), -std::sqrt(144 - off * off), off < 9 ? 1.3 : 2.4) << off;
    }
  EXPECT_NEAR(encountered, std::numbers::pi * 144, 40);
}

TEST(PictureStore, TakesLooksAndCutsAndAnEye) {
  const BallHost host;
  PictureStore store(host);
  const std::string front(kFront);
  // transparent
  const auto hidden = wait_for(store, front + "&looks=ffffffffff000000");
  ASSERT_NE(hidden, nullptr);
  EXPECT_EQ(Observed(*hidden).structure_index(24, 24), 0);
  // red
  const auto red = wait_for(store, front + "&looks=ffffffffff0000ff");
  ASSERT_NE(red, nullptr);
  EXPECT_GT(Observed(*red).red(24, 24), 180);
  // without its front half the ball begins at its centre, 0 mm from the picture's plane at y = 20
  const auto cut = wait_for(store, front + "&cut=20,20,20,0,-1,0");
  ASSERT_NE(cut, nullptr);
  EXPECT_NEAR(Observed(*cut).depth_mm(24, 24), 0, 0.7);
  // perspective from 60 mm in front of that plane
  const auto near = wait_for(store, front + ",20,-40,20");
  ASSERT_NE(near, nullptr);
  EXPECT_NEAR(Observed(*near).depth_mm(24, 24), 60 - 12, 0.8);
  EXPECT_NE(Observed(*near).structure_index(12, 24), 0);
}

TEST(PictureStore, NextPictureOmitsRemovedTissue) {
  BallHost host;
  PictureStore store(host);
  const auto whole = wait_for(store, kFront);
  ASSERT_NE(whole, nullptr);
  EXPECT_NEAR(Observed(*whole).depth_mm(24, 24), -12, 1.3);
  // a hole from the front to the centre
  Bricks<LabelId> holed =
      host.ball.labels->with({{{16, 4, 16}, {8, 16, 8}}, std::vector<LabelId>(8 * 16 * 8, 0)});
  const auto put = [&](std::shared_ptr<const Bricks<LabelId>> labels) {
    const std::lock_guard lock(host.mutex);
    host.now = std::move(labels);
  };
  put(std::make_shared<const Bricks<LabelId>>(holed));
  const auto cut = wait_for(store, kFront);
  ASSERT_NE(cut, nullptr);
  EXPECT_NEAR(Observed(*cut).depth_mm(24, 24), 0, 1.3);
  EXPECT_NEAR(Observed(*cut).depth_mm(16, 24), Observed(*whole).depth_mm(16, 24), 0.1);
  // equal to a new store with the same labels, with other looks, too
  BallHost other;
  other.ball.labels = std::make_shared<const Bricks<LabelId>>(holed);
  PictureStore anew(other);
  EXPECT_EQ(*wait_for(anew, kFront), *cut);
  const std::string red = std::string(kFront) + "&looks=ffffffffff0000ff";
  EXPECT_EQ(*wait_for(anew, red), *wait_for(store, red));
  // undone
  put(host.ball.labels);
  EXPECT_EQ(*wait_for(store, kFront), *whole);
}

TEST(PictureStore, SkipsRequestsOfDisconnectedViewers) {
  const BallHost host;
  PictureStore store(host);
  const auto key = parse_picture_query(kFront, 2);
  ASSERT_TRUE(key);
  int granted = 0;
  for (int n = 0; n < 5; ++n)
    store.request(*key, std::weak_ptr<int>(), [&](PictureStore::Payload) { ++granted; });
  EXPECT_NE(wait_for(store, kFront), nullptr);
  EXPECT_EQ(granted, 0);
}

TEST(PictureStore, EndsWithWishesOpen) {
  const BallHost host;
  const auto requester = std::make_shared<int>(0);
  PictureStore store(host);
  const auto key = parse_picture_query(kFront, 2);
  ASSERT_TRUE(key);
  // the oldest requests beyond the limit are answered with null at once
  std::atomic<int> reported{0};
  for (std::size_t n = 0; n < 3 * PictureStore::kMaxWaiting; ++n)
    store.request(*key, requester, [&](PictureStore::Payload) { ++reported; });
  EXPECT_GE(reported, 1);
}

TEST(ViewerServer, DrawsPicturesOfTheVolume) {
  TestServer test({}, {32, 32, 32});
  const std::string target = "/api/picture/0f3a000000000001?view=64,48,-70,-70,0,1,0,0,0,1,0";
  const auto plain = request(test.port(), "GET", target);
  EXPECT_EQ(plain.status, 200);
  EXPECT_EQ(plain.field("Cache-Control"), "no-store");
  ASSERT_EQ(plain.body.size(), 24u + 6 * 64 * 48);
  EXPECT_EQ(plain.body.substr(0, 4), "PLPV");
  const auto packed = request(test.port(), "GET", target, "Accept-Encoding: gzip\r\n");
  EXPECT_EQ(packed.field("Content-Encoding"), "gzip");
  EXPECT_LT(packed.body.size(), plain.body.size());
  EXPECT_EQ(request(test.port(), "GET", target + "&looks=1").status, 400);
  EXPECT_EQ(request(test.port(), "GET", "/api/picture/00?view=64,48,0,0,0,1,0,0,0,1,0").status, 404);
}

TEST(PictureStore, ShowsDeformationToPermittedViewers) {
  struct DentedHost : BallHost {
    DentedHost() {
      Volume<LabelId> smaller(ball.labels->geometry());
      for (int k = 0; k < 40; ++k)
        for (int j = 0; j < 40; ++j)
          for (int i = 0; i < 40; ++i)
            smaller.at(i, j, k) = Eigen::Vector3d(i - 20, j - 20, k - 20).norm() < 6 ? 2 : 0;
      seen = label_bricks(smaller);
    }
    std::shared_ptr<const Bricks<LabelId>> visible_labels() const override { return seen; }
    std::shared_ptr<const Bricks<LabelId>> seen;
  };
  const DentedHost host;
  const Redaction redaction(host.scene());
  PictureStore store(host);
  const auto edge_at = [&](const Redaction* through) {
    auto key = parse_picture_query(kFront, 2);
    key->redaction = through;
    std::promise<PictureStore::Payload> promise;
    const auto requester = std::make_shared<int>(0);
    store.request(*key, requester,
                  [&](PictureStore::Payload payload) { promise.set_value(std::move(payload)); });
    const auto payload = promise.get_future().get();
    if (payload == nullptr) return -1;
    const Observed observed(*payload);
    int column = 24;
    while (column < 48 && observed.structure_index(column, 24) != 0) ++column;
    return column - 24;
  };
  EXPECT_NEAR(edge_at(nullptr), 6, 1);
  EXPECT_NEAR(edge_at(&redaction), 12, 1) << "at rest";
  EXPECT_NEAR(edge_at(nullptr), 6, 1);
}

}  // namespace
}  // namespace palpate::server
