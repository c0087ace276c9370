# The sources of host_bits, for this build and for tests/bits/cross.
set(host_bits_sources host_bits.cc render_frame.cc frame_cases.cc exposure_cases.cc view_cases.cc tables.cc
                      ../support/scenes.cc ../../server/session/exposure_track.cc)
