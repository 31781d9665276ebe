"""From pictures to numbers: cameras, boards, spots, benches, and rendered pictures."""
