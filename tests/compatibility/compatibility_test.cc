// Programs built with an older render.proto still understand today's, and the check of this finds every kind
// of change that breaks them.
#include <google/protobuf/descriptor.pb.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <memory>

#include "absl/strings/str_join.h"
#include "candela/v1/render.pb.h"
#include "tests/compatibility/breaking_changes.h"
#include "tests/support/files.h"

namespace candela::testing {
namespace {

using google::protobuf::DescriptorPool;
using google::protobuf::DescriptorProto;
using google::protobuf::EnumDescriptorProto;
using google::protobuf::EnumValueDescriptorProto;
using google::protobuf::FieldDescriptorProto;
using google::protobuf::FileDescriptor;
using google::protobuf::FileDescriptorProto;
using google::protobuf::FileDescriptorSet;
using google::protobuf::MethodDescriptorProto;

const FileDescriptor& current() { return *v1::Settings::descriptor()->file(); }

// A contract that is not this program's own.
class Contract {
 public:
  explicit Contract(const FileDescriptorProto& file) {
    FileDescriptorProto descriptors;
    FileDescriptorProto::descriptor()->file()->CopyTo(&descriptors);
    pool_.BuildFile(descriptors);  // render.proto imports it
    file_ = pool_.BuildFile(file);
  }
  const FileDescriptor& file() const { return *file_; }

 private:
  DescriptorPool pool_;
  const FileDescriptor* file_ = nullptr;
};

// One of a repeated field's messages, by name.
template <typename Messages>
auto& named(Messages* messages, const std::string& name) {
  return *std::find_if(messages->begin(), messages->end(), [&](const auto& m) { return m.name() == name; });
}

DescriptorProto& message(FileDescriptorProto& file, const std::string& name) {
  return named(file.mutable_message_type(), name);
}
FieldDescriptorProto& field(FileDescriptorProto& file, const std::string& in, const std::string& name) {
  return named(message(file, in).mutable_field(), name);
}
EnumDescriptorProto& transfer(FileDescriptorProto& file) {
  return named(file.mutable_enum_type(), "Transfer");
}
MethodDescriptorProto& method(FileDescriptorProto& file, const std::string& name) {
  return named(file.mutable_service(0)->mutable_method(), name);
}
v1::Setting& setting(FileDescriptorProto& file, const std::string& in, const std::string& name) {
  return *field(file, in, name).mutable_options()->MutableExtension(v1::setting);
}

// Today's contract after a change.
FileDescriptorProto changed(const std::function<void(FileDescriptorProto&)>& change) {
  FileDescriptorProto file;
  current().CopyTo(&file);
  change(file);
  return file;
}

TEST(Compatibility, NothingInARecordedContractHasChanged) {
  int recorded = 0;
  for (const auto& entry : std::filesystem::directory_iterator(CANDELA_RECORDED_CONTRACTS)) {
    if (entry.path().extension() != ".binpb") continue;
    FileDescriptorSet set;
    ASSERT_TRUE(set.ParseFromString(read_file(entry.path()))) << entry.path();
    ASSERT_EQ(set.file_size(), 1) << entry.path();
    const Contract older(set.file(0));
    EXPECT_EQ(absl::StrJoin(breaking_changes(older.file(), current()), "\n"), "")
        << "programs built with " << entry.path().filename()
        << " would break; docs/compatibility.md says what may change";
    ++recorded;
  }
  EXPECT_GT(recorded, 0);
}

struct Change {
  const char* name;
  std::function<void(FileDescriptorProto&)> make;
  const char* found;  // all that the check reports, lines joined
};

void PrintTo(const Change& change, std::ostream* out) { *out << change.name; }

class CompatibilityOf : public ::testing::TestWithParam<Change> {};

TEST_P(CompatibilityOf, AChangeIsFoundOrAllowed) {
  const Contract newer(changed(GetParam().make));
  EXPECT_EQ(absl::StrJoin(breaking_changes(current(), newer.file()), "\n"), GetParam().found);
}

const Change kChanges[] = {
    {"Nothing", [](auto&) {}, ""},
    {"NewField",
     [](auto& file) {
       FieldDescriptorProto& added = *message(file, "Bloom").add_field();
       added.set_name("radius");
       added.set_number(1000);
       added.set_type(FieldDescriptorProto::TYPE_DOUBLE);
       added.set_label(FieldDescriptorProto::LABEL_OPTIONAL);
     },
     ""},
    {"NewEnumValue",
     [](auto& file) {
       EnumValueDescriptorProto& added = *transfer(file).add_value();
       added.set_name("TRANSFER_NEW");
       added.set_number(1000);
     },
     ""},
    {"WiderRange", [](auto& file) { setting(file, "Bloom", "intensity").set_max(11); }, ""},
    {"Help", [](auto& file) { setting(file, "Bloom", "intensity").set_help("How strong"); }, ""},
    {"RenumberedField", [](auto& file) { field(file, "Bloom", "softness").set_number(1000); },
     "candela.v1.Bloom.softness: number was 3 and is 1000"},
    {"RenamedField", [](auto& file) { field(file, "FrameHeader", "width").set_name("columns"); },
     "candela.v1.FrameHeader.width: is missing"},
    {"RemovedField", [](auto& file) { message(file, "FrameHeader").mutable_field()->DeleteSubrange(1, 1); },
     "candela.v1.FrameHeader.width: is missing"},
    {"JsonName", [](auto& file) { field(file, "FrameHeader", "width").set_json_name("columns"); },
     "candela.v1.FrameHeader.width: JSON name was width and is columns"},
    {"RetypedField",
     [](auto& file) { field(file, "FrameHeader", "width").set_type(FieldDescriptorProto::TYPE_UINT64); },
     "candela.v1.FrameHeader.width: type was uint32 and is uint64"},
    {"RetypedMessage",
     [](auto& file) { field(file, "RenderStart", "frame").set_type_name(".candela.v1.Rectangle"); },
     "candela.v1.RenderStart.frame: type was candela.v1.FrameHeader and is candela.v1.Rectangle"},
    {"Repeated",
     [](auto& file) { field(file, "FrameHeader", "width").set_label(FieldDescriptorProto::LABEL_REPEATED); },
     "candela.v1.FrameHeader.width: cardinality was without presence and is repeated, packed"},
    {"LostPresence",
     [](auto& file) {
       FieldDescriptorProto& levels = field(file, "Bloom", "levels");
       levels.clear_proto3_optional();
       levels.clear_oneof_index();
       DescriptorProto& bloom = message(file, "Bloom");
       for (auto it = bloom.mutable_oneof_decl()->begin(); it != bloom.mutable_oneof_decl()->end(); ++it) {
         if (it->name() != "_levels") continue;
         const int removed = static_cast<int>(it - bloom.mutable_oneof_decl()->begin());
         bloom.mutable_oneof_decl()->erase(it);
         for (FieldDescriptorProto& other : *bloom.mutable_field()) {
           if (other.has_oneof_index() && other.oneof_index() > removed)
             other.set_oneof_index(other.oneof_index() - 1);
         }
         break;
       }
     },
     "candela.v1.Bloom.levels: cardinality was with presence and is without presence"},
    {"RenamedOneof",
     [](auto& file) { message(file, "RenderRequest").mutable_oneof_decl(0)->set_name("piece"); },
     "candela.v1.RenderRequest.start: cardinality was in the oneof part and is in the oneof piece\n"
     "candela.v1.RenderRequest.band: cardinality was in the oneof part and is in the oneof piece\n"
     "candela.v1.RenderRequest.part: is missing"},
    {"RenumberedEnumValue", [](auto& file) { transfer(file).mutable_value(2)->set_number(1000); },
     "candela.v1.TRANSFER_GAMMA22: number was 2 and is 1000"},
    {"RemovedEnumValue", [](auto& file) { transfer(file).mutable_value()->DeleteSubrange(3, 1); },
     "candela.v1.TRANSFER_LINEAR: is missing"},
    {"RemovedMethod", [](auto& file) { file.mutable_service(0)->mutable_method()->DeleteSubrange(2, 1); },
     "candela.v1.RenderService.Meter: is missing"},
    {"NoStream", [](auto& file) { method(file, "Meter").set_client_streaming(false); },
     "candela.v1.RenderService.Meter: request was a stream and is one message"},
    {"OtherAnswer", [](auto& file) { method(file, "Meter").set_output_type(".candela.v1.RenderResponse"); },
     "candela.v1.RenderService.Meter: answer was candela.v1.MeterResponse and is candela.v1.RenderResponse"},
    {"RenamedService", [](auto& file) { file.mutable_service(0)->set_name("Renderer"); },
     "candela.v1.RenderService: is missing"},
    {"OtherDefault", [](auto& file) { setting(file, "Bloom", "softness").set_default_(0.25); },
     "candela.v1.Bloom.softness: default was 0.5 and is 0.25"},
    {"OtherDefaultWord", [](auto& file) { setting(file, "Bloom", "kind").set_default_word("conserve"); },
     "candela.v1.Bloom.kind: default was mip and is conserve"},
    {"NarrowerRange", [](auto& file) { setting(file, "Bloom", "intensity").set_max(9); },
     "candela.v1.Bloom.intensity: range was 0 .. 10 and is 0 .. 9"},
    {"NoExceptionForTheDefault", [](auto& file) { setting(file, "Bloom", "threshold").clear_except(); },
     "candela.v1.Bloom.threshold with kind gaussian: default was 8 and is 1"},
    {"NoExceptionForTheRange", [](auto& file) { setting(file, "Bloom", "intensity").clear_except(); }, ""},
    {"ExceptionForAKnownChoice",
     [](auto& file) {
       v1::Setting::Exception& added = *setting(file, "Bloom", "intensity").add_except();
       added.set_choice("kind");
       added.set_word("mip");
       added.set_max(2);
     },
     "candela.v1.Bloom.intensity with kind mip: range was 0 .. 10 and is 0 .. 2"},
    {"ExceptionForANewChoice",
     [](auto& file) {
       v1::Setting::Exception& added = *setting(file, "Bloom", "intensity").add_except();
       added.set_choice("kind");
       added.set_word("starburst");
       added.set_max(2);
     },
     ""},
};
INSTANTIATE_TEST_SUITE_P(Changes, CompatibilityOf, ::testing::ValuesIn(kChanges),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(Compatibility, AReservedNumberOrNameIsNotUsedAgain) {
  const Contract older(changed([](FileDescriptorProto& file) {
    DescriptorProto::ReservedRange& range = *message(file, "Rectangle").add_reserved_range();
    range.set_start(5);
    range.set_end(7);
    message(file, "Rectangle").add_reserved_name("depth");
  }));
  const Contract newer(changed([](FileDescriptorProto& file) {
    FieldDescriptorProto& depth = *message(file, "Rectangle").add_field();
    depth.set_name("depth");
    depth.set_number(6);
    depth.set_type(FieldDescriptorProto::TYPE_UINT32);
    depth.set_label(FieldDescriptorProto::LABEL_OPTIONAL);
  }));
  EXPECT_EQ(absl::StrJoin(breaking_changes(older.file(), newer.file()), "\n"),
            "candela.v1.Rectangle.depth: uses the reserved 6\n"
            "candela.v1.Rectangle.depth: uses the reserved depth");
}

}  // namespace
}  // namespace candela::testing
