#include "servo/model_slot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

namespace palpate {
namespace {

using ::testing::HasSubstr;

std::shared_ptr<const Model> model(std::uint32_t version) {
  auto made = std::make_shared<Model>();
  made->version = version;
  return made;
}

TEST(ModelSlot, KeepsModelsThatATickMayStillUse) {
  ModelSlot slot(model(1));
  EXPECT_EQ(slot.begin_tick().version, 1u);
  EXPECT_TRUE(slot.set(model(2)).ok());
  EXPECT_EQ(slot.collect(), 2u) << "the tick that began before still uses the first";
  slot.end_tick();
  EXPECT_EQ(slot.collect(), 1u);
  EXPECT_EQ(slot.begin_tick().version, 2u);
  EXPECT_TRUE(slot.set(model(3)).ok());
  EXPECT_TRUE(slot.set(model(4)).ok());
  EXPECT_EQ(slot.collect(), 3u);
  slot.end_tick();
  EXPECT_EQ(slot.collect(), 1u);
  EXPECT_TRUE(slot.set(model(5)).ok());
  EXPECT_EQ(slot.collect(), 1u) << "between ticks nothing is used";
}

TEST(ModelSlot, TicksNeverUseAFreedModel) {
  // every model sets a flag when it is freed; the ticks check it
  struct Marked {
    std::atomic<bool> dead{false};
  };
  std::vector<std::unique_ptr<Marked>> marks(2001);
  for (auto& mark : marks) mark = std::make_unique<Marked>();
  const auto made = [&](std::uint32_t version) {
    auto plain = std::make_shared<Model>();
    plain->version = version;
    const Model* raw = plain.get();
    return std::shared_ptr<const Model>(raw,
                                        [plain, &marks](const Model* m) { marks[m->version]->dead = true; });
  };
  ModelSlot slot(made(0));
  std::atomic<bool> done{false};
  std::atomic<int> wrong{0}, ticks{0};
  std::thread servo([&] {
    for (; !done; ++ticks) {
      const Model& used = slot.begin_tick();
      for (int n = 0; n < 50; ++n) wrong += marks[used.version]->dead.load();
      slot.end_tick();
    }
  });
  // some in quick succession, some with ticks in between
  for (std::uint32_t version = 1; version <= 2000; ++version) {
    const int before = ticks;
    while (version % 20 == 0 && ticks == before) std::this_thread::yield();
    EXPECT_TRUE(slot.set(made(version)).ok());
  }
  done = true;
  servo.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(ticks, 100);
  EXPECT_EQ(slot.collect(), 1u);
}

TEST(ModelSlot, RejectsALowerVersionAndKeepsItsModel) {
  ModelSlot slot(model(2));
  // the same version, prepared for more methods
  EXPECT_TRUE(slot.set(model(2)).ok());
  const auto refused = slot.set(model(1));
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  EXPECT_THAT(refused.error().message(), HasSubstr("version 1 is lower than version 2"));
  EXPECT_FALSE(slot.set(nullptr).ok());
  EXPECT_EQ(slot.begin_tick().version, 2u);
  slot.end_tick();
}

}  // namespace
}  // namespace palpate
