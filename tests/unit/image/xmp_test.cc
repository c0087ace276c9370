// The properties of XMP packets.
#include "client/image/read/xmp.h"

#include <gtest/gtest.h>

#include <string>

#include "absl/strings/str_cat.h"

namespace candela {
namespace {

constexpr char kGain[] = "http://ns.adobe.com/hdr-gain-map/1.0/";
constexpr char kRdf[] = "xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'";

// "name=value" of each, with its item.
std::string properties(const std::string& packet) {
  std::string all;
  for (const XmpProperty& one : xmp_properties(packet)) {
    absl::StrAppend(&all, all.empty() ? "" : " ", one.item, ":", one.name, "=", one.value);
  }
  return all;
}

TEST(Xmp, NamesBelongToUris) {
  const std::string space = absl::StrCat("xmlns:a='", kGain, "'");
  EXPECT_EQ(properties(absl::StrCat("<x ", space, " a:B='1' b:B='2' B='3'/>")), "0:B=1");
  EXPECT_EQ(properties(absl::StrCat("<x xmlns='", kGain, "' B='3'>4</x>")), "0:x=4");
  // The innermost declaration counts, inside of its element.
  EXPECT_EQ(properties(absl::StrCat("<x ", space, "><y xmlns:a='other' a:B='1'/><a:C>2</a:C></x>")), "0:C=2");
  EXPECT_EQ(properties(absl::StrCat("<?xpacket begin='\xef\xbb\xbf'?><!-- a:B='1' --><x ", space,
                                    "><a:B>&#49;<![CDATA[2]]></a:B></x>\n<?xpacket end='w'?>",
                                    std::string(9, '\0'))),
            "0:B=12");
}

TEST(Xmp, ValuesBelongToTheNameAroundThem) {
  EXPECT_EQ(
      properties(absl::StrCat("<x ", kRdf, " xmlns:a='", kGain,
                              "'><a:B> <rdf:Seq><rdf:li>1</rdf:li>\n<rdf:li> 2 </rdf:li></rdf:Seq></a:B>"
                              "<a:C rdf:parseType='Resource'><rdf:value>3</rdf:value></a:C></x>")),
      "1:B=1 2:B=2 2:C=3");
}

TEST(Xmp, HostilePacketsHaveNone) {
  const std::string space = absl::StrCat("xmlns:a='", kGain, "'"),
                    good = absl::StrCat("<x ", space, " a:B='1'>");
  EXPECT_EQ(properties(good + "</x>"), "0:B=1");
  EXPECT_EQ(properties(good), "");
  EXPECT_EQ(properties(good + "<y></x>"), "");
  EXPECT_EQ(properties(good + "&none;</x>"), "");
  EXPECT_EQ(properties("<!DOCTYPE x [<!ENTITY e 'e'>]>" + good + "</x>"), "");
  EXPECT_EQ(properties(""), "");
  std::string deep = good, ends;
  for (int i = 0; i < 31; ++i) {
    deep += "<y>";
    ends += "</y>";
  }
  EXPECT_EQ(properties(deep + ends + "</x>"), "0:B=1");
  EXPECT_EQ(properties(deep + "<y/>" + ends + "</x>"), "");
}

}  // namespace
}  // namespace candela
