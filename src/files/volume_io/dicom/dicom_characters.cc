#include "volume_io/dicom/dicom_characters.h"

#include <unicode/ucnv.h>
#include <unicode/ustring.h>

#include <algorithm>
#include <array>
#include <memory>

namespace palpate::volume_io {
namespace {

constexpr const char* kAscii = "US-ASCII";
constexpr const char* kLatin1 = "ISO-8859-1";
// JIS X 0201: Shift_JIS has the same letters above 0x80, and ICU has no separate table
constexpr const char* kKatakana = "Shift_JIS";

// Number of a registered set, as in "ISO_IR 100" and "ISO 2022 IR 100", and ICU's name of a converter whose
// bytes below 0x80 are ASCII and whose other bytes are those of the registered set.
struct RegisteredSet {
  std::string_view number;
  const char* converter;
};
constexpr std::array kRegistered{RegisteredSet{"6", kAscii},          RegisteredSet{"100", kLatin1},
                                 RegisteredSet{"101", "ISO-8859-2"},  RegisteredSet{"109", "ISO-8859-3"},
                                 RegisteredSet{"110", "ISO-8859-4"},  RegisteredSet{"144", "ISO-8859-5"},
                                 RegisteredSet{"127", "ISO-8859-6"},  RegisteredSet{"126", "ISO-8859-7"},
                                 RegisteredSet{"138", "ISO-8859-8"},  RegisteredSet{"148", "ISO-8859-9"},
                                 RegisteredSet{"203", "ISO-8859-15"}, RegisteredSet{"13", kKatakana},
                                 RegisteredSet{"166", "TIS-620"},     RegisteredSet{"192", "UTF-8"},
                                 RegisteredSet{"149", "EUC-KR"},      RegisteredSet{"58", "GB2312"}};

// Effect of an ISO 2022 escape sequence: it changes the meaning of bytes below 0x80 (G0) or above (G1).
enum class G0 { kSingleByte, kJisX0208, kJisX0212 };
struct Escape {
  std::string_view sequence;  // the bytes after ESC
  std::optional<G0> g0;
  const char* g1 = nullptr;  // ICU's converter name; null: G1 is unchanged
};
constexpr std::array kEscapes{Escape{"(B", G0::kSingleByte},   Escape{"(J", G0::kSingleByte, nullptr},
                              Escape{"$B", G0::kJisX0208},     Escape{"$(D", G0::kJisX0212},
                              Escape{")I", {}, kKatakana},     Escape{"$)C", {}, "EUC-KR"},
                              Escape{"$)A", {}, "GB2312"},     Escape{"-A", {}, kLatin1},
                              Escape{"-B", {}, "ISO-8859-2"},  Escape{"-C", {}, "ISO-8859-3"},
                              Escape{"-D", {}, "ISO-8859-4"},  Escape{"-L", {}, "ISO-8859-5"},
                              Escape{"-G", {}, "ISO-8859-6"},  Escape{"-F", {}, "ISO-8859-7"},
                              Escape{"-H", {}, "ISO-8859-8"},  Escape{"-M", {}, "ISO-8859-9"},
                              Escape{"-b", {}, "ISO-8859-15"}, Escape{"-T", {}, "TIS-620"}};

bool is_high(char c) {
  return (static_cast<unsigned char>(c) & 0x80) != 0;
}

bool append_converted(std::string_view bytes, const char* converter, std::string& utf8) {
  UErrorCode status = U_ZERO_ERROR;
  const std::unique_ptr<UConverter, void (*)(UConverter*)> open(ucnv_open(converter, &status), ucnv_close);
  if (U_FAILURE(status)) return false;
  ucnv_setToUCallBack(open.get(), UCNV_TO_U_CALLBACK_STOP, nullptr, nullptr, nullptr, &status);
  // a byte yields at most two UTF-16 units, and a unit at most three bytes of UTF-8
  std::u16string units(2 * bytes.size() + 1, u'\0');
  const std::int32_t length = ucnv_toUChars(open.get(), units.data(), static_cast<std::int32_t>(units.size()),
                                            bytes.data(), static_cast<std::int32_t>(bytes.size()), &status);
  if (U_FAILURE(status)) return false;
  std::string converted(3 * static_cast<std::size_t>(length) + 1, '\0');
  std::int32_t written = 0;
  u_strToUTF8(converted.data(), static_cast<std::int32_t>(converted.size()), &written, units.data(), length,
              &status);
  if (U_FAILURE(status)) return false;
  utf8.append(converted, 0, static_cast<std::size_t>(written));
  return true;
}

// ICU's converter for a set that is used alone, "ISO_IR 144"; null: unknown
const char* converter_of(std::string_view set) {
  if (set.empty()) return kAscii;
  if (set == "GB18030") return "gb18030";
  if (set == "GBK") return "GBK";
  for (const std::string_view prefix : {"ISO_IR ", "ISO 2022 IR "}) {
    if (!set.starts_with(prefix)) continue;
    for (const RegisteredSet& known : kRegistered)
      if (known.number == set.substr(prefix.size())) return known.converter;
  }
  return nullptr;
}

/// Converter of text with escape sequences, run by run.
class Iso2022Text {
 public:
  explicit Iso2022Text(const char* initial_g1) : initial_g1_(initial_g1), g1_(initial_g1) {}

  std::optional<std::string> in_utf8(std::string_view text) {
    while (!text.empty()) {
      if (text.front() == '\x1B') {
        const auto escape = std::ranges::find_if(
            kEscapes, [&](const Escape& one) { return text.substr(1).starts_with(one.sequence); });
        if (escape == kEscapes.end() || !end_run()) return std::nullopt;
        if (escape->g0) g0_ = *escape->g0;
        if (escape->g1) g1_ = escape->g1;
        text.remove_prefix(1 + escape->sequence.size());
        continue;
      }
      run_ += text.front();
      // a new value or component resets to the first set of the file
      if (g0_ == G0::kSingleByte &&
          std::string_view("\\^=\r\n\f\t").find(text.front()) != std::string_view::npos) {
        if (!end_run()) return std::nullopt;
        g1_ = initial_g1_;
      }
      text.remove_prefix(1);
    }
    if (!end_run()) return std::nullopt;
    return std::move(utf8_);
  }

 private:
  bool end_run() {
    bool good = true;
    if (!run_.empty()) {
      if (g0_ == G0::kSingleByte)
        good = append_converted(run_, g1_, utf8_);
      else
        good = append_converted(as_euc_jp(), "EUC-JP", utf8_);
      run_.clear();
    }
    return good;
  }

  // pairs of 7-bit bytes as the 8-bit pairs of EUC-JP
  std::string as_euc_jp() const {
    std::string bytes;
    for (std::size_t n = 0; n < run_.size(); ++n) {
      if (g0_ == G0::kJisX0212 && n % 2 == 0) bytes += '\x8F';
      bytes += is_high(run_[n]) ? '?' : static_cast<char>(run_[n] | 0x80);
    }
    return bytes;
  }

  const char* initial_g1_;
  const char* g1_;
  G0 g0_ = G0::kSingleByte;
  std::string run_, utf8_;
};

}  // namespace

std::optional<std::string> dicom_text_in_utf8(std::string_view text, std::string_view set) {
  const bool plain = std::ranges::none_of(text, [](char c) { return is_high(c) || c == '\x1B'; });
  if (plain) return std::string(text);
  std::string_view first = set.substr(0, set.find('\\'));
  while (first.ends_with(' ')) first.remove_suffix(1);
  const bool extended = set.find('\\') != std::string_view::npos || first.starts_with("ISO 2022");
  const char* converter = converter_of(first);
  if (!converter) return std::nullopt;
  if (extended) return Iso2022Text(converter).in_utf8(text);
  std::string utf8;
  if (!append_converted(text, converter, utf8)) return std::nullopt;
  return utf8;
}

}  // namespace palpate::volume_io
