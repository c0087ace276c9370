#include "client/image/read/xmp.h"

#include <expat.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/strip.h"

namespace candela {
namespace {

constexpr size_t kMostDepth = 32;

XmpSpace space_of(absl::string_view uri) {
  constexpr std::pair<absl::string_view, XmpSpace> kSpaces[] = {
      {"http://www.w3.org/1999/02/22-rdf-syntax-ns#", XmpSpace::kRdf},
      {"http://ns.adobe.com/hdr-gain-map/1.0/", XmpSpace::kGainMap},
      {"http://ns.google.com/photos/1.0/container/", XmpSpace::kContainer},
      {"http://ns.google.com/photos/1.0/container/item/", XmpSpace::kContainerItem},
      {"http://ns.apple.com/HDRGainMap/1.0/", XmpSpace::kAppleGainMap}};
  const auto* const found = std::ranges::find(kSpaces, uri, [](const auto& space) { return space.first; });
  return found == std::end(kSpaces) ? XmpSpace::kOther : found->second;
}

// Takes expat's events. Prefixes are resolved here: expat would write their URIs out in every name, and a
// packet of 64 KiB could ask for gigabytes of them.
class XmpParser {
 public:
  XmpParser() : parser_(XML_ParserCreate(nullptr)) {
    XML_SetUserData(parser_.get(), this);
    XML_SetElementHandler(
        parser_.get(),
        [](void* self, const char* name, const char** attributes) {
          static_cast<XmpParser*>(self)->begin(name, attributes);
        },
        [](void* self, const char*) { static_cast<XmpParser*>(self)->end(); });
    XML_SetCharacterDataHandler(parser_.get(), [](void* self, const char* text, int size) {
      std::vector<Element>& open = static_cast<XmpParser*>(self)->open_;
      if (!open.empty()) open.back().text.append(text, static_cast<size_t>(size));
    });
    XML_SetStartDoctypeDeclHandler(parser_.get(), [](void* self, const char*, const char*, const char*, int) {
      XML_StopParser(static_cast<XmpParser*>(self)->parser_.get(), XML_FALSE);
    });
  }

  std::vector<XmpProperty> parse(absl::string_view packet) {
    XML_Parse(parser_.get(), packet.data(), static_cast<int>(packet.size()), XML_TRUE);
    return is_whole_ ? std::move(found_) : std::vector<XmpProperty>{};
  }

 private:
  struct Name {
    XmpSpace space;
    std::string local;
  };
  struct Prefix {
    std::string text;
    XmpSpace space;
  };
  struct Element {
    Name name;
    std::string text;
    size_t prefixes;  // declared before it
  };

  // `word` is PREFIX:LOCAL. Without a prefix, an element has the default space and an attribute none.
  Name name_of(absl::string_view word, bool is_attribute) const {
    const size_t colon = std::min(word.find(':'), word.size());
    const absl::string_view prefix = colon < word.size() ? word.substr(0, colon) : "";
    const std::string local(word.substr(colon < word.size() ? colon + 1 : 0));
    if (is_attribute && prefix.empty()) return {XmpSpace::kOther, local};
    const auto found = std::find_if(prefixes_.rbegin(), prefixes_.rend(),
                                    [&](const Prefix& one) { return one.text == prefix; });
    return {found == prefixes_.rend() ? XmpSpace::kOther : found->space, local};
  }

  void begin(absl::string_view word, const char** attributes) {
    if (open_.size() == kMostDepth) {
      XML_StopParser(parser_.get(), XML_FALSE);
      return;
    }
    const size_t prefixes = prefixes_.size();
    for (const char** at = attributes; *at != nullptr; at += 2) {
      absl::string_view name = at[0];
      if (!absl::ConsumePrefix(&name, "xmlns")) continue;
      if (name.empty() || absl::ConsumePrefix(&name, ":"))
        prefixes_.push_back({std::string(name), space_of(at[1])});
    }
    open_.push_back({name_of(word, false), "", prefixes});
    const Name& name = open_.back().name;
    if ((name.space == XmpSpace::kRdf && name.local == "li") ||
        (name.space == XmpSpace::kContainer && name.local == "Item")) {
      ++item_;
    }
    for (const char** at = attributes; *at != nullptr; at += 2) add(name_of(at[0], true), at[1]);
  }

  void end() {
    const auto owner = std::find_if(open_.rbegin(), open_.rend(), [](const Element& element) {
      return element.name.space != XmpSpace::kRdf;
    });
    if (owner != open_.rend()) add(owner->name, open_.back().text);
    prefixes_.resize(open_.back().prefixes);
    open_.pop_back();
    if (!open_.empty()) return;
    is_whole_ = true;
    XML_StopParser(parser_.get(), XML_FALSE);  // zeros may follow
  }

  void add(const Name& name, absl::string_view text) {
    const absl::string_view value = absl::StripAsciiWhitespace(text);
    if (name.space == XmpSpace::kOther || name.space == XmpSpace::kRdf || value.empty()) return;
    found_.push_back({name.space, name.local, std::string(value), item_});
  }

  struct Free {
    void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
  };
  const std::unique_ptr<XML_ParserStruct, Free> parser_;
  std::vector<Element> open_;     // from the root to the innermost
  std::vector<Prefix> prefixes_;  // the last of a name counts
  std::vector<XmpProperty> found_;
  int item_ = 0;
  bool is_whole_ = false;
};

}  // namespace

std::vector<XmpProperty> xmp_properties(absl::string_view packet) { return XmpParser().parse(packet); }

}  // namespace candela
