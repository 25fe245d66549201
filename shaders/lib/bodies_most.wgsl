// Parts that lie behind one another, where some overlap: as many as a mask has bits.
const MAX_BODIES: u32 = 32u;
