#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <regex>

#include "base/test_seed.h"
#include "haply/messages.h"

namespace palpate::haply {
namespace {

constexpr const char* kInventory =
    R"({"session_id":7,"inverse3":[{"device_id":"049D","config":{"type":"inverse3","handedness":"right"},)"
    R"("state":{"cursor_position":{"x":0.01,"y":-0.12,"z":0.15},"cursor_velocity":{"x":0,"y":0.5,"z":0},)"
    R"("control_mode":"idle"},"status":{"calibrated":true,"in_use":false,"power_supply":true,"ready":true,)"
    R"("started":true}}],"verse_grip":[{"device_id":"61548","state":{"button":true,"hall":0,)"
    R"("orientation":{"w":0.7071067811865476,"x":0,"y":0,"z":0.7071067811865476}}}]})";

TEST(HaplyMessages, AreReadInMillimetres) {
  const auto state = parse_state(kInventory);
  ASSERT_TRUE(state);
  ASSERT_EQ(state->devices.size(), 1u);
  const Inverse3& device = state->devices[0];
  EXPECT_EQ(device.id, "049D");
  ASSERT_TRUE(device.tip_mm);
  EXPECT_NEAR((device.tip_mm->eigen() - Eigen::Vector3d(10, -120, 150)).norm(), 0, 1e-9);
  EXPECT_NEAR((device.velocity_mm_s.eigen() - Eigen::Vector3d(0, 500, 0)).norm(), 0, 1e-9);
  EXPECT_EQ(device.status.calibrated, true);
  EXPECT_EQ(device.status.in_use, false);
  ASSERT_EQ(state->grips.size(), 1u);
  EXPECT_EQ(state->grips[0].buttons, 1u);
  // a quarter turn about up rotates right to forward
  EXPECT_NEAR((state->grips[0].orientation * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 0,
              1e-9);
}

TEST(HaplyMessages, WirelessGripHasThreeButtons) {
  const auto state = parse_state(
      R"({"inverse3":[],"wireless_verse_grip":[{"state":{"buttons":{"a":true,"b":false,"c":true}}}]})");
  ASSERT_TRUE(state);
  EXPECT_EQ(state->grips[0].buttons, 5u);
  EXPECT_EQ(state->grips[0].orientation.w(), 1);
}

TEST(HaplyMessages, NonNumericFieldsAreAbsent) {
  for (const char* position_text : {R"({"x":null,"y":0,"z":0})", R"({"x":"1","y":0,"z":0})",
                                    R"({"x":0,"y":0})", "[0,0,0]", R"({"x":1e306,"y":0,"z":0})", "7"}) {
    const auto state = parse_state(
        std::string(R"({"inverse3":[{"device_id":"A","state":{"cursor_position":)") + position_text + "}}]}");
    ASSERT_TRUE(state) << position_text;
    EXPECT_FALSE(state->devices[0].tip_mm) << position_text;
  }
  for (const char* broken : {"", "{", "[]", "null", R"({"inverse3":{}})", R"({"hello":1})",
                             R"({"inverse3":[{"state":{"cursor_position":{"x":1e999,"y":0,"z":0}}}]})"})
    EXPECT_FALSE(parse_state(broken)) << broken;
}

TEST(HaplyMessages, AreStrictJson) {
  const std::string whole = kInventory;
  for (const std::string& after :
       {std::string("x"), std::string("{}"), std::string("\0", 1), std::string("\0x", 2)})
    EXPECT_FALSE(parse_state(whole + after));
  for (const char* broken : {"\xff", "\xc3", "\xed\xa0\x80", "\n", R"(\x)", R"(\ud800)", R"(\u12)"})
    EXPECT_FALSE(parse_state(std::string(R"({"inverse3":[{"device_id":")") + broken + "\"}]}")) << broken;
  const auto named = parse_state(R"({"inverse3":[{"device_id":"\u00e4\ud834\udd1e\"\n"}]})");
  ASSERT_TRUE(named);
  EXPECT_EQ(named->devices[0].id, "\u00e4\U0001d11e\"\n");
}

// deeply nested and long messages neither overflow the stack nor a buffer
TEST(HaplyMessages, AreReadHoweverDeepOrLong) {
  for (const int depth : {10, 1000, 1'000'000}) {
    const std::string nested = std::string(depth, '[') + std::string(depth, ']');
    const auto state = parse_state(R"({"inverse3":[],"more":)" + nested + "}");
    EXPECT_TRUE(state) << depth;
    EXPECT_FALSE(parse_state(R"({"inverse3":[],"more":)" + nested)) << depth;
  }
  std::string many;
  for (int n = 0; n < 5000; ++n)
    many += std::string(n == 0 ? "" : ",") + R"({"device_id":"D)" + std::to_string(n) +
            R"(","state":{"cursor_position":{"x":0.125,"y":0,"z":-1}}})";
  const auto state = parse_state(R"({"inverse3":[)" + many + "]}");
  ASSERT_TRUE(state);
  ASSERT_EQ(state->devices.size(), 5000u);
  EXPECT_EQ(state->devices[4999].id, "D4999");
  EXPECT_EQ(state->devices[4999].tip_mm->eigen(), Eigen::Vector3d(125, 0, -1000));
}

/// Compares with an independent library: positions agree within a few units in the last place.
void expect_positions_of(const State& state, const nlohmann::json& message) {
  for (std::size_t n = 0; n < state.devices.size(); ++n) {
    const auto at = [&](const char* axis) -> std::optional<double> {
      const nlohmann::json::json_pointer path("/state/cursor_position/" + std::string(axis));
      const nlohmann::json& entry = message["inverse3"][n];
      if (!entry.contains(path) || !entry[path].is_number()) return std::nullopt;
      return 1000 * entry[path].get<double>();
    };
    const auto x = at("x"), y = at("y"), z = at("z");
    const bool known = x && y && z && std::isfinite(*x + *y + *z);
    ASSERT_EQ(state.devices[n].tip_mm.has_value(), known) << message;
    if (known) {
      const Eigen::Vector3d other(*x, *y, *z), off = state.devices[n].tip_mm->eigen() - other;
      for (int axis = 0; axis < 3; ++axis)
        ASSERT_LE(std::abs(off[axis]), 2e-15 * std::abs(other[axis])) << message;
    }
  }
}

// an inventory with random changes or truncation: the result is usable, and equal to that of an independent
// library
TEST(HaplyMessages, ArbitraryBytesAreHarmless) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  int read = 0;
  for (int n = 0; n < 3000; ++n) {
    std::string text = kInventory;
    for (unsigned changes = random() % 4; changes > 0; --changes)
      text[random() % text.size()] = static_cast<char>(random());
    if (random() % 4 == 0) text.resize(random() % text.size());
    // RapidJSON rejects exponents out of range even if the mantissa is zero
    if (std::regex_search(text, std::regex("[eE][+]?[0-9]{3}"))) continue;
    const auto state = parse_state(text);
    const auto other = nlohmann::json::parse(text, nullptr, false);
    ASSERT_EQ(state.has_value(), !other.is_discarded() && other.is_object() && other.contains("inverse3") &&
                                     other["inverse3"].is_array())
        << text;
    if (!state) continue;
    ++read;
    ASSERT_EQ(state->devices.size(), other["inverse3"].size());
    expect_positions_of(*state, other);
    for (const Inverse3& device : state->devices) ASSERT_TRUE(!device.tip_mm || device.tip_mm->all_finite());
    for (const Grip& grip : state->grips) ASSERT_NEAR(grip.orientation.norm(), 1, 1e-9);
  }
  EXPECT_GT(read, 300);
}

TEST(HaplyMessages, DistinguishesVersions) {
  const auto key = [](std::string_view text) -> std::string {
    const auto version = parse_version(text);
    const char* found = version ? force_key(*version) : nullptr;
    return found ? found : "none";
  };
  EXPECT_EQ(key("3.0.2"), "values");
  EXPECT_EQ(key(R"({"version":"3.1.1"})"), "values");
  EXPECT_EQ(key("\"3.5\""), "vector");
  EXPECT_EQ(key("Inverse Service v3.10.4"), "vector");
  // unsupported versions
  for (const char* unknown : {"2.9.1", "3.2.0", "4.0.0", "3", "", "x", "999999999999.1"})
    EXPECT_EQ(key(unknown), "none") << unknown;
}

TEST(HaplyMessages, RequestsAreJsonWithTheForceInNewtons) {
  RequestWriter writer({"049D", "odd \"id\""}, "vector");
  std::array<DeviceCommand, 2> commands;
  commands[0].force_N = Vector<Device>(0, -1.25, 1.5);
  commands[1].force_N = Vector<Device>(std::nan(""), 1e-30, INFINITY);
  const auto first = nlohmann::json::parse(writer.write(true, commands));
  EXPECT_EQ(first.at("session").at("configure").at("profile").at("name"), "palpate");
  EXPECT_EQ(first.at("session").at("basis").at("permutation"), "XYZ");
  const auto later = nlohmann::json::parse(writer.write(false, commands));
  EXPECT_FALSE(later.contains("session"));
  const auto& force = later.at("inverse3").at(0).at("commands").at("set_cursor_force").at("vector");
  EXPECT_EQ(force.at("x"), 0);
  EXPECT_EQ(force.at("y"), -1.25);
  EXPECT_EQ(force.at("z"), 1.5);
  EXPECT_EQ(later.at("inverse3").at(0).at("device_id"), "049D");
  const auto& odd = later.at("inverse3").at(1);
  EXPECT_EQ(odd.at("device_id"), "odd \"id\"");
  EXPECT_EQ(odd.at("commands").at("set_cursor_force").at("vector").at("x"), 0) << "what is no number";
  EXPECT_EQ(odd.at("commands").at("set_cursor_force").at("vector").at("z"), 0);
}

}  // namespace
}  // namespace palpate::haply
