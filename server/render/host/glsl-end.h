#undef float
#undef int
#undef uint
#undef bool
#undef precise
