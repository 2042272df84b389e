#include "palpate/json/json.h"

#include <gtest/gtest.h>

#include <limits>

namespace palpate {
namespace {

TEST(Json, IsWrittenInTheOrderInWhichItWasMade) {
  Json json{{"name", "femur"}, {"value", 3}, {"size_mm", 0.1}, {"touchable", true}, {"colour", {255, 0, 10}}};
  json["absent"] = nullptr;
  json["name"] = "tibia";
  EXPECT_EQ(json.dump(),
            R"({"name":"tibia","value":3,"size_mm":0.1,"touchable":true,"colour":[255,0,10],"absent":null})");
  EXPECT_EQ(Json(Json{{"a", {{"b", 1}}}}).dump(2), "{\n  \"a\": {\n    \"b\": 1\n  }\n}");
}

TEST(Json, TellsObjectsFromArraysAsTheyAreWritten) {
  EXPECT_EQ((Json{{"en", "passed"}}).dump(), R"({"en":"passed"})");
  EXPECT_EQ((Json{"en", "passed"}).dump(), R"(["en","passed"])");
  EXPECT_EQ((Json{{1, 2}, {3, 4}}).dump(), "[[1,2],[3,4]]");
  EXPECT_EQ(Json::array().dump(), "[]");
  EXPECT_EQ(Json::object().dump(), "{}");
  EXPECT_EQ(Json(std::vector<std::string>{"a", "b"}).dump(), R"(["a","b"])");
  EXPECT_EQ(Json(std::array<int, 3>{1, 2, 3}).dump(), "[1,2,3]");
}

TEST(Json, WritesNumbersAndBytesThatJsonDoesNotHave) {
  EXPECT_EQ(Json(std::numeric_limits<double>::quiet_NaN()).dump(), "null");
  EXPECT_EQ(Json(1.0).dump(), "1.0");
  EXPECT_EQ(Json(1e300).dump(), "1e+300");
  EXPECT_EQ(Json(std::numeric_limits<std::uint64_t>::max()).dump(), "18446744073709551615");
  EXPECT_EQ(Json("a\xff\n").dump(), "\"a\xef\xbf\xbd\\n\"");
}

TEST(Json, RoundTrips) {
  const Json json{{"a", {1, -2, 0.5}}, {"b", {{"c", "d"}, {"e", nullptr}}}, {"f", false}};
  const auto again = Json::parse(json.dump());
  ASSERT_TRUE(again);
  EXPECT_EQ(*again, json);
  EXPECT_EQ(again->at("a").get<std::vector<double>>(), (std::vector<double>{1, -2, 0.5}));
  EXPECT_EQ((again->at("a").get<std::array<int, 2>>()), (std::array<int, 2>{1, -2}));
  EXPECT_EQ(again->at("b").at("c"), "d");
  EXPECT_FALSE(again->at("f").get<bool>());
}

TEST(Json, SortsMembersAndKeepsTheLastDuplicate) {
  const auto json = Json::parse(R"({"b": 1, "a": 2, "b": 3})");
  ASSERT_TRUE(json);
  EXPECT_EQ(json->dump(), R"({"a":2,"b":3})");
}

TEST(Json, RejectsInvalidJson) {
  for (const char* text : {"", "{", "[1,]", "{\"a\": 1,}", "nan", "1 2", "{1: 2}", "\"\xff\"", "1e999"})
    EXPECT_FALSE(Json::parse(text)) << text;
  EXPECT_TRUE(Json::parse(std::string(500, '[') + std::string(500, ']')));
  EXPECT_FALSE(Json::parse(std::string(501, '[') + std::string(501, ']')));
  EXPECT_FALSE(Json::parse(std::string(1'000'000, '[')));
}

TEST(Json, NamesMissingMembers) {
  const Json json{{"a", 1}};
  EXPECT_EQ(json.find("b"), nullptr);
  EXPECT_EQ(json.at("a").find("b"), nullptr);
  EXPECT_THROW(json.at("b"), JsonError);
  EXPECT_THROW(json.at("a").get<std::string>(), JsonError);
  EXPECT_THROW(json.at("a").get<bool>(), JsonError);
  EXPECT_THROW(json.get<int>(), JsonError);
  EXPECT_THROW(Json::array()[0], JsonError);
  EXPECT_EQ(json.at("a").begin(), json.at("a").end());
}

TEST(Json, UpdatesMembers) {
  Json json{{"a", 1}, {"b", 2}};
  json.update({{"b", 3}, {"c", 4}});
  EXPECT_EQ(json.dump(), R"({"a":1,"b":3,"c":4})");
  Json list;
  list.push_back({{"n", 1}});
  list.back()["m"] = 2;
  EXPECT_EQ(list.dump(), R"([{"n":1,"m":2}])");
}

}  // namespace
}  // namespace palpate
