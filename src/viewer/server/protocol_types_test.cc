#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/base/contact_properties.h"
#include "palpate/base/file.h"
#include "palpate/device/session_settings.h"
#include "palpate/server/tick_history.h"
#include "palpate/server/viewer_host.h"
#include "server/bundle_message.h"

namespace palpate::server {
namespace {

// types of the page for values in messages
constexpr const char* type_of(bool /*value*/) {
  return "boolean";
}
constexpr const char* type_of(int /*value*/) {
  return "number";
}
constexpr const char* type_of(double /*value*/) {
  return "number";
}
const char* type_of(const std::string& /*value*/) {
  return "string";
}
const char* type_of(const std::optional<std::string>& /*value*/) {
  return "string | null";
}
constexpr const char* type_of(const std::array<double, 3>& /*value*/) {
  return "Vec3";
}
constexpr const char* type_of(const std::array<double, 4>& /*value*/) {
  return "Quaternion";
}
const char* type_of(const std::vector<std::array<double, 3>>& /*value*/) {
  return "Vec3[]";
}
const char* type_of(const std::vector<ViewedTool::Capsule>& /*value*/) {
  return "Capsule[]";
}

// type of a number in a binary message, and how many of them there are
template <class Value>
constexpr std::string_view kWireType = "";
template <>
constexpr std::string_view kWireType<float> = "f32";
template <>
constexpr std::string_view kWireType<double> = "f64";
template <>
constexpr std::string_view kWireType<std::uint32_t> = "u32";
template <>
constexpr std::string_view kWireType<std::uint64_t> = "u64";
struct WireField {
  std::string name, type, description;
  std::size_t offset = 0, count = 1;
};
/// Numbers of a part of a message, in order.
class WireFields {
 public:
  template <class Value>
  void operator()(const char* name, const Value& /*value*/, const char* description) {
    add<Value>(name, 1, description);
  }
  template <class Value, std::size_t kCount>
  void operator()(const char* name, const std::array<Value, kCount>& /*values*/, const char* description) {
    add<Value>(name, kCount, description);
  }
  const std::vector<WireField>& fields() const { return fields_; }
  std::size_t bytes() const { return bytes_; }

 private:
  template <class Value>
  void add(const char* name, std::size_t count, const char* description) {
    fields_.push_back({name, std::string(kWireType<Value>), description, bytes_, count});
    bytes_ += count * sizeof(Value);
  }

  std::vector<WireField> fields_;
  std::size_t bytes_ = 0;
};
template <class Part>
WireFields wire_fields() {
  WireFields fields;
  visit_wire_fields(Part(), fields);
  return fields;
}

/// TypeScript text, line by line.
class Module {
 public:
  void line(std::string_view text = "") { (text_ += text) += "\n"; }
  void field(std::string_view name, std::string_view type) {
    line("  " + std::string(name) + ": " + std::string(type) + ";");
  }
  void names(const std::string& constant, const std::vector<std::string_view>& values) {
    line("export const " + constant + " = [");
    for (const std::string_view value : values) line("  \"" + std::string(value) + "\",");
    line("] as const;");
  }
  template <class Fields>
  void interface(std::string_view name, std::string_view about, const Fields& fields) {
    line("/** " + std::string(about) + " */");
    line("export interface " + std::string(name) + " {");
    visit_fields(fields,
                 [&](const char* field_name, const auto& value) { field(field_name, type_of(value)); });
    line("}\n");
  }
  void wire(const std::string& constant, const std::string& about, const WireFields& part) {
    line("/** " + about + " */");
    line("export const " + constant + " = {");
    for (const WireField& field : part.fields())
      line("  " + field.name + ": { offset: " + std::to_string(field.offset) + ", type: \"" + field.type +
           "\", count: " + std::to_string(field.count) + " },");
    line("} as const;");
    line("export const " + constant + "_BYTES = " + std::to_string(part.bytes()) + ";");
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

void add_settings(Module& module) {
  module.line("/** Settings that a tick reads, as in `set` and `state`. */");
  module.line("export interface Settings {");
  visit_settings([&](const auto& setting) {
    module.field(setting.name, type_of(message_value(Settings{}.*setting.value)));
  });
  module.line("}");
  std::vector<std::string_view> names, haptic;
  visit_settings([&](const auto& setting) { names.push_back(setting.name); });
  for (const SwitchInfo& info : kSwitches)
    if (info.is_haptic) haptic.push_back(info.name);
  module.names("SETTING_NAMES", names);
  module.line(
      "/** Switches that need the permission to change contact settings; the page shows them as check boxes. "
      "*/");
  module.names("HAPTIC_SWITCHES", haptic);
  module.line();
}

void add_contact_properties(Module& module) {
  module.line("/** Properties of a tissue that may change during a session, as in `tissue`. */");
  module.line("export interface ContactProperties {");
  for (const ContactProperty& property : kContactProperties) module.field(property.name, "number");
  module.line("}\n");
  module.line("/** Permitted values: the range of the force limit, and that of each contact property. */");
  module.line("export interface Limits extends Record<keyof ContactProperties, [number, number]> {");
  for (const char* name : {"max_force_N", "min_max_force_N", "max_max_force_N"}) module.field(name, "number");
  module.line("}\n");
}

std::string protocol_types() {
  Module module;
  module.line(
      "// Types of the protocol that palpate derives from its tables of settings, contact properties and "
      "tools.");
  module.line(
      "// Written by PALPATE_UPDATE_DOCS=1 server_test --gtest_filter='ProtocolTypes.*', not by hand.\n");
  module.line("import type { Quaternion, Vec3 } from \"../base/geometry.js\";\n");
  add_settings(module);
  add_contact_properties(module);
  module.interface("Capsule", "Convex hull of two balls, in the tool's frame.", ViewedTool::Capsule{});
  module.interface("DeviceTool", "Tool held by one device, in the tool's frame.", ViewedTool{});
  module.wire("BUNDLED_TICK", "Numbers of each tick in a bundle (`PLPB`).", wire_fields<BundledTick>());
  module.wire("BUNDLED_DEVICE", "Numbers of each of its devices, which follow it.",
              wire_fields<BundledDevice>());
  module.line();
  // without the empty line at the end
  return module.text().substr(0, module.text().size() - 1);
}

TEST(ProtocolTypes, PageTypesEqualTheTables) {
  const std::string path = PALPATE_SOURCE_DIR "/web/src/protocol/protocol.gen.ts";
  if (std::getenv("PALPATE_UPDATE_DOCS") != nullptr) {
    ASSERT_TRUE(write_file(path, protocol_types()).ok());
    return;
  }
  const auto text = read_file(path);
  ASSERT_TRUE(text.ok()) << text.error().message();
  EXPECT_EQ(*text, protocol_types()) << "PALPATE_UPDATE_DOCS=1 server_test --gtest_filter='ProtocolTypes.*'";
}

// table of the manual
std::string wire_table(const WireFields& part) {
  std::string table = "| offset | type | name | content |\n|---|---|---|---|\n";
  for (const WireField& field : part.fields())
    table += "| " + std::to_string(field.offset) + " | `" + field.type +
             (field.count > 1 ? "[" + std::to_string(field.count) + "]" : "") + "` | `" + field.name +
             "` | " + field.description + " |\n";
  return table;
}

TEST(ProtocolTypes, ManualStatesTheBundleSizes) {
  EXPECT_EQ(wire_fields<BundledTick>().bytes(), kBundledTick_bytes);
  EXPECT_EQ(wire_fields<BundledDevice>().bytes(), kBundledDevice_bytes);
  const std::string path = PALPATE_SOURCE_DIR "/docs/reference/viewer-messages.md";
  std::string text = *read_file(path);
  for (const auto& [part, table] : {std::pair("tick", wire_table(wire_fields<BundledTick>())),
                                    std::pair("device", wire_table(wire_fields<BundledDevice>()))}) {
    const std::string begin = std::string("<!-- bundled ") + part + " begin -->\n",
                      end = std::string("<!-- bundled ") + part + " end -->";
    const std::size_t first = text.find(begin) + begin.size(), last = text.find(end);
    ASSERT_NE(last, std::string::npos);
    if (std::getenv("PALPATE_UPDATE_DOCS") != nullptr)
      text.replace(first, last - first, table);
    else
      EXPECT_EQ(text.substr(first, last - first), table)
          << "PALPATE_UPDATE_DOCS=1 server_test --gtest_filter='ProtocolTypes.*'";
  }
  if (std::getenv("PALPATE_UPDATE_DOCS") != nullptr) {
    ASSERT_TRUE(write_file(path, text).ok());
  }
}

}  // namespace
}  // namespace palpate::server
