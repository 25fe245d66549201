// Objects of more than four bodies.
const MAX_BODIES: u32 = 16u;
