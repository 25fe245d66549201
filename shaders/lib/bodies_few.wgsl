// Objects of up to four bodies: software adapters take an array that is indexed by a variable to pieces, in which each number costs.
const MAX_BODIES: u32 = 4u;
